"""`canarm check`: what it accepts runs, and what cannot run it refuses with the rule."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from canarm.cli import run
from canarm.rig.rig import Rig
from canarm_protocol.cell.cell_file import load_cell, shipped_cells
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
    assert "ran for 2 s with mras on sine\nok\n" in capsys.readouterr().out


def test_moments_of_inertia_that_no_body_has_are_refused(check: Check) -> None:
    status, said = check("inertia_kg_m2 = [0.0, 2.7e-3, 2.7e-3]", "inertia_kg_m2 = [0.0, 2.7e-3, 0.27e-3]")
    assert status == 2
    assert "joint 'joint2'.link.inertia_kg_m2 = [0, 0.0027, 0.00027]: no body has it" in said
    assert "A + B >= C" in said


def test_a_number_whose_square_no_float_holds_is_refused(check: Check) -> None:
    status, said = check("gear_ratio = 60.0", "gear_ratio = 1e308")
    assert status == 2
    assert "gear_ratio = 1e+308: must be at most 1000000000.0" in said


def test_a_gear_that_stops_the_robot_is_found_by_running(check: Check) -> None:
    # 3600 becomes 3.6e9: the rotor weighs 54 t m2, and no amplifier moves it along the motion.
    status, said = check("gear_ratio = 60.0", "gear_ratio = 60_000.0")
    assert status == 2
    assert "was stopped within 2 s: current-mismatch: joint2" in said


def test_an_amplifier_too_weak_to_hold_the_arm_is_found(check: Check) -> None:
    status, said = check("max_current_a = 1.5                  # D669", "max_current_a = 0.3")
    assert status == 2
    assert "0.3 A, all that the amplifier has" in said


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
