"""`canarm check`: what it accepts runs, and what cannot run it refuses with the rule."""

import io
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from canarm.announced import announced
from canarm.cli import run
from canarm.rig.rig import Rig
from canarm.soundness import weak_brakes
from canarm_protocol.cell.cell_file import load_cell, parse_cell, shipped_cells
from canarm_protocol.cell.inertia import is_possible

Check = Callable[[str, str], tuple[int, str]]


@pytest.fixture
def check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Check:
    """Checks konkuk1 with one text in place of another: exit status, and what was said."""

    def checked(old: str, new: str) -> tuple[int, str]:
        text = shipped_cells()["konkuk1"]
        assert old in text
        path = tmp_path / "mine.toml"
        path.write_text(text.replace(old, new, 1))
        status = run(["check", "--cell", str(path)])
        said = capsys.readouterr()
        return status, said.out if status == 0 else said.err

    return checked


def test_a_cell_that_ships_is_run_before_it_is_called_right(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check"]) == 0
    assert "ran for 3 s with mras on sine and trapezoid\nok\n" in capsys.readouterr().out


def test_moments_of_inertia_that_no_body_has_are_refused(check: Check) -> None:
    status, said = check("inertia_kg_m2 = [0.0, 2.7e-3, 2.7e-3]", "inertia_kg_m2 = [0.0, 2.7e-3, 0.27e-3]")
    assert status == 2
    assert "joint 'joint2'.link.inertia_kg_m2 = [0, 0.0027, 0.00027]: no body has it" in said
    assert "A + B >= C" in said


def test_a_number_whose_square_no_float_holds_is_refused(check: Check) -> None:
    status, said = check("gear_ratio = 60.0", "gear_ratio = 1e308")
    assert status == 2
    assert "gear_ratio = 1e+308: must be at most 1000000000.0" in said


def test_a_gear_that_stops_the_robot_is_found_by_running(check: Check, monkeypatch: pytest.MonkeyPatch) -> None:
    # 3600 becomes 3.6e9: the rotor weighs 54 t m2, and no supply drives it. Arithmetic knows it, and a run shows it.
    status, said = check("gear_ratio = 60.0", "gear_ratio = 60_000.0")
    assert status == 2
    assert "one step of the potentiometer of joint 'joint2', 1.06 deg, moves its command by 35.2 A" in said
    monkeypatch.setattr("canarm.rehearsal.unsound", lambda cell: ())
    status, said = check("gear_ratio = 60.0", "gear_ratio = 60_000.0")
    assert status == 2
    assert "was stopped within 3 s on sine: " in said


def test_an_amplifier_too_weak_to_hold_the_arm_is_found(check: Check) -> None:
    status, said = check("max_current_a = 1.5                  # D669", "max_current_a = 0.3")
    assert status == 2
    # 2.472 N m of weight (0.606 A x 4.08 N m/A) where a pose within the limits has all of it, and 0.15 of friction.
    assert "joint 'joint2'.drive.max_current_a = 0.3: weight and friction of 2.59 N m over 4.08 N m/A take 0.634 A" in (
        said
    )


@pytest.mark.parametrize(
    ("old", "new", "arithmetic"),
    [
        # 2.59 N m over 4.08 N m/A: 0.634 A, in 2.5 ohm 1.58 V.
        (
            "supply_v = 15.0",
            "supply_v = 1.5e-5",
            "joint 'joint2'.drive.supply_v = 1.5e-05: the 0.634 A that hold the arm",
        ),
        # 2.4 N m of weight (2.59 with friction) over 1e-6 N m/rad: more than any wire can turn; 0.1 rad may be.
        ("wire_stiffness_nm_rad = 200.0 ", "wire_stiffness_nm_rad = 1e-6", "degrees; must be at least 2"),
        # 2.4 x 12 rad/s x (2 x 2.5 ms + 500 ms) = 14.5 rad.
        ("winding_mh = 1.25 ", "winding_mh = 1250.0 ", "505 ms, cost 14.5 rad of phase; must be at most 0.975 rad"),
        # 2.4 x 12e6 rad/s x 5.5 ms = 158 000 rad; 0.975 rad / 2.4 / 5.5 ms = 73.9 rad/s.
        (
            "natural_frequency_rad_s = 12.0",
            "natural_frequency_rad_s = 12e6",
            "1.58e+05 rad of phase; must be at most 0.975",
        ),
        # A step of 1500 A / 255 = 5.88 A; rounding alone is 0.29 of it.
        (
            "full_scale_a = 1.5",
            "full_scale_a = 1500.0",
            "0.42 steps of 5.88 A) are 19.6 A, of drive.max_current_a = 1.5",
        ),
        ("full_scale_a = 1.5", "full_scale_a = 1.0", "full_scale_a = 1: drive.max_current_a = 1.5 is beyond it"),
        (
            "missing_cycles = 16",
            "speed_jump_lsb = 5e-6\nmissing_cycles = 16",
            "speed_jump_lsb = 5e-06: steps and noise of the sensors",
        ),
        (
            "missing_cycles = 16",
            "current_mismatch_a = 1e-4\nmissing_cycles = 16",
            "current_mismatch_a = 0.0001: steps and noise",
        ),
    ],
)
def test_numbers_that_do_not_go_together_are_refused_with_the_arithmetic(
    check: Check, old: str, new: str, arithmetic: str
) -> None:
    status, said = check(old, new)
    assert status == 2
    assert arithmetic in said
    assert all(line.startswith("canarm: ") and "mine.toml: " in line for line in said.splitlines())


def test_a_law_that_loses_the_arm_is_named_and_the_others_are_not_blamed(check: Check) -> None:
    status, said = check("velocity_noise_rad_s = 0.0082", "velocity_noise_rad_s = 82.0")
    assert status == 0
    (line,) = [line for line in said.splitlines() if line.startswith("law ")]
    assert line.startswith("law slotine-li: ")


def test_detectors_that_speak_without_a_fault_are_heard(check: Check, monkeypatch: pytest.MonkeyPatch) -> None:
    # Beyond the arithmetic: limits that it lets through, and a sound run does not.
    monkeypatch.setattr("canarm.rehearsal.unsound", lambda cell: ())
    status, said = check("missing_cycles = 16", "current_mismatch_a = 1e-3\nmissing_cycles = 16")
    assert status == 2
    assert "current" in said
    assert "without any fault, it raised: " in said or "was stopped within 3 s" in said


OWN_GAINS = '[[control.joint]]\nname = "joint3"\nnatural_frequency_rad_s = 8.0\n\n[supervision]'


def test_a_joint_with_gains_of_its_own_is_shown_with_them_and_runs(check: Check) -> None:
    status, said = check("[supervision]", OWN_GAINS)
    assert status == 0
    lines = [line for line in said.splitlines() if line.startswith("joint ")]
    assert lines[0].endswith("loop 12 rad/s, damping 1")
    assert lines[1].endswith("loop 8 rad/s, damping 1")


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('"joint3"', '"joint4"', "control.joint 'joint4': no such joint; this cell has joint2, joint3"),
        ("= 8.0", "= -8.0", "control.joint 'joint3'.natural_frequency_rad_s = -8.0: must be greater than 0"),
        ("natural_", "natral_", "control.joint 'joint3'.natral_frequency_rad_s: unknown key; did you mean"),
        ("= 8.0", "= 8e6", "control.joint 'joint3'.natural_frequency_rad_s = 8e+06: at joint 'joint3' the loop"),
    ],
)
def test_gains_of_a_joint_are_checked_as_those_of_the_cell(check: Check, old: str, new: str, complaint: str) -> None:
    status, said = check("[supervision]", OWN_GAINS.replace(old, new, 1))
    assert status == 2
    assert complaint in said


def test_a_rig_warns_of_a_bit_rate_that_is_too_low() -> None:
    cell = load_cell("konkuk1")
    slow = cell.model_copy(update={"bus": cell.bus.model_copy(update={"bitrate": 125_000})})
    with pytest.warns(UserWarning, match="the cyclic traffic does not fit 125000 bit/s"):
        Rig(slow)


def test_every_body_has_a_possible_inertia_and_its_mirror_in_the_triangle_has_not() -> None:
    # Points of mass at random: whatever they are, their tensor is one of a body's.
    random = np.random.default_rng(3)
    for count in (1, 2, 3, 10):
        for _ in range(50):
            points, masses = random.normal(size=(count, 3)), random.uniform(0.1, 1.0, count)
            squares = np.einsum("p,pi,pk->ik", masses, points, points)
            tensor = np.trace(squares) * np.eye(3) - squares
            moments, products = np.diag(tensor), tensor[[0, 0, 1], [1, 2, 2]]
            assert is_possible(moments, products)
            turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
            impossible = turn @ np.diag([1.0, 1.0, 2.01]) @ turn.T
            assert not is_possible(np.diag(impossible), impossible[[0, 0, 1], [1, 2, 2]])


@pytest.mark.parametrize(("torque_nm", "holds"), [(2.45, True), (2.1, False)])
def test_a_spring_brake_that_the_weight_turns_is_told_with_the_arithmetic(torque_nm: float, holds: bool) -> None:
    """Stretched out level, joint 2 bears 1 kg at 90 mm and 0.6 kg at 270 mm; its Coulomb friction is 0.15 N m."""
    weight_nm = 9.8062 * (1.0 * 0.09 + 0.6 * 0.27)
    text = shipped_cells()["konkuk1-brakes"].replace("torque_nm = 5.0", f"torque_nm = {torque_nm}")
    told = list(weak_brakes(parse_cell(text, "mine.toml")))
    if holds:
        assert told == []
        return
    (line,) = told
    assert line.startswith("joint 'joint2'.brake.torque_nm = 2.1: with coulomb_friction_nm = 0.15 it is less than")
    weight = re.search(r"weight of ([0-9.]+) N m", line)
    assert weight is not None
    assert float(weight[1]) == pytest.approx(weight_nm, rel=0.02)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_somebody_at_a_terminal_is_told_what_takes_so_long(monkeypatch: pytest.MonkeyPatch) -> None:
    for stream, said in ((Terminal(), "canarm: trying the cell ... "), (io.StringIO(), "")):
        monkeypatch.setattr("sys.stderr", stream)
        with announced("trying the cell"):
            assert stream.getvalue() == said.rstrip(" ")
        assert stream.getvalue().startswith(said)
        assert stream.getvalue()[len(said) :] == "" or re.fullmatch(r"\d+\.\d s\n", stream.getvalue()[len(said) :])
