"""Identification: what is found of a robot whose truth is known, how sure it is said to be, and what is refused."""

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from canarm import Rig, open_run
from canarm.cli import run as canarm_here
from canarm.identify.estimate import quantile
from canarm.identify.identification import Identification, identified
from canarm.identify.motion import fitted, motion_of
from canarm.identify.physical import USUAL, Kind
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.text_file import parse_toml

sys.path.append(str(Path(__file__).parents[2] / "scripts"))
import identification

TRUTH = {"joint3.mass": 1.1, "joint2.coulomb": 0.25, "joint3.coulomb": 0.04, "joint2.torque_constant": 0.083}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """10 s of `excite` on a robot that differs from the cell, without the emulator's table, which has what is true."""
    path = tmp_path_factory.mktemp("identified") / "run"
    with Rig("konkuk1", law="mras", trajectory="excite", seed=7, truth=TRUTH, out=path) as rig:
        rig.run(10.0)
    (path / "signals" / "robot.csv").unlink()
    return path


@pytest.fixture(scope="module")
def found(recorded: Path) -> Identification:
    return identified(open_run(recorded), USUAL)


def values(of: Identification) -> dict[str, tuple[float, float]]:
    ((_, _, fit),) = of.robots
    return {each.parameter.name: (each.value, each.half) for each in fit.estimates}


def test_mass_and_friction_are_found_within_what_is_promised(found: Identification) -> None:
    known = values(found)
    assert known["joint3.mass"][0] == pytest.approx(1.1, rel=0.02)
    assert known["joint2.coulomb"][0] == pytest.approx(0.25, rel=0.1)
    assert known["joint3.coulomb"][0] == pytest.approx(0.04, rel=0.1)
    assert known["joint2.torque_constant"][0] == pytest.approx(0.083, rel=0.02)
    assert known["joint2.mass"][0] == pytest.approx(1.0, rel=0.03)


def test_most_intervals_hold_and_are_narrow(found: Identification) -> None:
    cell = load_cell("konkuk1")
    nominal = {"joint2.mass": 1.0, "joint2.viscous": 0.05, "joint3.viscous": 0.02, "joint3.torque_constant": 0.08}
    known, truth = values(found), {**nominal, **TRUTH}
    held = [name for name, (value, half) in known.items() if abs(value - truth[name]) <= half]
    assert len(held) >= 6, held
    assert set(known) == set(truth)
    assert known["joint3.mass"][1] < 0.02 * 1.1
    assert cell.joint_names == ("joint2", "joint3")


def test_the_lines_for_the_cell_are_toml_with_what_was_found(found: Identification) -> None:
    lines = list(found.lines())
    toml = lines[lines.index("lines for the cell:") + 1 :]
    third = parse_toml("\n".join(toml[toml.index("# joint3") :]))["robot"]["joint"]
    mass = values(found)["joint3.mass"][0]
    assert third["link"]["mass_kg"] == pytest.approx(mass, rel=1e-3)
    # A uniform rod of 0.18 m: m L^2 / 12.
    assert third["link"]["inertia_kg_m2"] == pytest.approx([0.0, mass * 0.0027, mass * 0.0027], rel=1e-3)
    assert third["motor"]["coulomb_friction_nm"] == pytest.approx(values(found)["joint3.coulomb"][0], rel=1e-3)


def test_with_the_centres_free_it_is_said_what_cannot_be_told_apart(recorded: Path, found: Identification) -> None:
    every = identified(open_run(recorded), tuple(Kind))
    assert every.robots[0][2].condition > 5.0 * found.robots[0][2].condition
    assert values(every)["joint2.mass"][1] > 3.0 * values(found)["joint2.mass"][1]
    text = "\n".join(every.lines())
    assert "joint2.mass" in text
    assert "hardly told from joint2.centre" in text


def test_a_joint_that_only_holds_is_not_excited_and_stays_as_in_the_cell(tmp_path: Path) -> None:
    home_rad = np.radians(20.0)

    def motion(time_s: float) -> tuple[float, float]:
        return home_rad, 0.3 * np.sin(3.0 * time_s)

    with Rig("konkuk1", law="computed-torque", trajectory=motion, out=tmp_path / "run") as rig:
        rig.run(5.0)
    still = identified(open_run(tmp_path / "run"), (Kind.COULOMB, Kind.VISCOUS))
    assert still.robots[0][2].condition == np.inf
    seen = {each.parameter.name: each.is_seen for each in still.robots[0][2].estimates}
    assert seen == {
        "joint2.coulomb": False,
        "joint3.coulomb": True,
        "joint2.viscous": False,
        "joint3.viscous": True,
    }
    text = "\n".join(still.lines())
    assert "the motion does not show everything; try --trajectory excite" in text
    assert "not excited: stays as in the cell" in text


def test_the_motion_is_reconstructed_from_eight_bits(tmp_path: Path) -> None:
    with Rig("konkuk1", law="mras", trajectory="excite", seed=3, out=tmp_path / "run", history_s=10.0) as rig:
        rig.run(6.0)
        run = open_run(tmp_path / "run")
        motion = motion_of(run.cell, run.controller)
        first = (rig.controller.controlled_ticks - len(motion.angle_rad)) // 2
        inner = slice(first, first + len(motion.angle_rad))
        for joint, name in enumerate(rig.joints):
            true = rig.joints[name]
            # A step of the potentiometer is 18.5 mrad, one of the tachometer 19.6 mrad/s.
            assert np.std(motion.angle_rad[:, joint] - true.true_angle_rad[inner]) < 1.5e-3
            assert np.std(motion.speed_rad_s[:, joint] - true.true_speed_rad_s[inner]) < 1e-2


def test_fitted_cubics_leave_cubics_and_slow_motions_as_they_are() -> None:
    time_s = np.arange(400) * 0.0025
    cubic = 1.0 + 2.0 * time_s - 3.0 * time_s**2 + 4.0 * time_s**3
    inner = slice(20, -20)
    for order, expected in enumerate((cubic, 2.0 - 6.0 * time_s + 12.0 * time_s**2, -6.0 + 24.0 * time_s)):
        np.testing.assert_allclose(fitted(cubic, 16, 0.0025, 0.0, order)[inner], expected[inner], atol=1e-7)
    later = np.sin(2 * np.pi * (time_s + 0.0007))
    np.testing.assert_allclose(
        fitted(np.sin(2 * np.pi * time_s), 16, 0.0025, 0.0007, 0)[inner], later[inner], atol=1e-4
    )


def test_the_quantile_grows_with_the_share_of_lags_as_its_authors_have_it() -> None:
    # Kiefer and Vogelsang (2005), table 1: Bartlett kernel, 97.5 %: 1.96 for none; 4.771 for all of them (Kiefer,
    # Vogelsang and Bunzel, 2000, have 4.771 for the same).
    assert quantile(0.0) == pytest.approx(1.96)
    assert quantile(1.0) == pytest.approx(4.771, rel=0.01)


def test_the_command_says_it_as_text_and_as_json(recorded: Path, canarm: Any) -> None:
    process = canarm("identify", str(recorded), "--json")
    assert process.wait() == 0, process
    (robot,) = process.json["robots"]
    assert robot["parameters"]["joint3.mass"]["found"] == pytest.approx(1.1, rel=0.02)
    assert robot["parameters"]["joint3.mass"]["cell"] == 0.6
    assert robot["condition"] < 100.0


def test_a_run_of_it_can_be_repeated_byte_for_byte(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Rig("konkuk1", law="pd", trajectory="excite", out=tmp_path / "run") as rig:
        rig.run(0.5)
    assert canarm_here(["replay", str(tmp_path / "run"), "--check"]) == 0
    assert "every byte of can0" in capsys.readouterr().out


def test_what_cannot_be_identified_is_refused_in_a_line(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def complaint(folder: Path, *words: str) -> str:
        assert canarm_here(["identify", str(folder), *words]) == 2
        return capsys.readouterr().err

    assert "there is no such folder" in complaint(tmp_path / "none")
    assert "must be masses, centres" in complaint(recorded, "--free", "mass")
    folder = Path(shutil.copytree(recorded, tmp_path / "run"))
    table = folder / "signals" / "controller.csv"
    rows = table.read_text().splitlines(keepends=True)
    table.write_text("".join(rows[:400]))
    assert "without a gap are recorded; must be 3 s at least" in complaint(folder)
    table.write_text("".join(rows).replace("joint3.measured_a", "joint3.measured_b"))
    assert "has no column joint3.measured_a" in complaint(folder)
    header = rows[0].split(",")
    place = header.index("joint3.measured_rad_s")
    spoilt = [row.split(",") for row in rows[1:]]
    for row in spoilt:
        row[place] = "nan"
    table.write_text(rows[0] + "".join(",".join(row) for row in spoilt))
    assert "joint3.measured_rad_s has a value that is no finite number" in complaint(folder)
    table.write_bytes(b"\x00\xff" * 100)
    assert f"{folder}: controller.csv: cannot be read: " in complaint(folder)
    table.unlink()
    assert "has no controller.csv" in complaint(folder)


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_of_drawn_robots_every_mass_and_friction_is_found_and_nine_of_ten_intervals_hold() -> None:
    """A share of what `scripts/identification.py` runs: 0.3 to 1.1 kg of payload, half to twice the friction."""
    cases = [identification.found_in(number) for number in range(12)]
    for case in cases:
        by_name = {each.name: each for each in case}
        assert abs(by_name["joint3.mass"].error) <= 0.02
        assert abs(by_name["joint2.coulomb"].error) <= 0.1
        assert abs(by_name["joint3.coulomb"].error) <= 0.1
    # 96 intervals of 95 %: fewer than 83 hold once in 1000 draws if they are right and independent.
    assert sum(each.holds for case in cases for each in case) >= 83
