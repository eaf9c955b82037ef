"""No law that ships diverges or chatters: other payloads, three times the noise, one more cycle of delay, at rest."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from canarm import Rig
from canarm_controller.laws import LAWS, ControlLaw, Cycle
from canarm_controller.run.state import State

NOISE_X3 = {"joint2.noise_lsb": 0.9, "joint3.noise_lsb": 0.9}
ROBOTS = {
    "payload -50 %": {"joint3.mass": 0.3},
    "payload +50 %": {"joint3.mass": 0.9},
    "noise x 3": NOISE_X3,
    "payload +50 %, noise x 3": {"joint3.mass": 0.9, **NOISE_X3},
}
*MILDER, WORST = ROBOTS
SHIPPED = ("pd", "computed-torque", "mras", "mras-lyapunov", "slotine-li")
LSB_RAD = np.radians(270.0 / 255)


def delayed(law: type[ControlLaw]) -> type[ControlLaw]:
    """`law`, whose every torque comes one cycle later; the first one twice."""

    class Delayed(law):  # type: ignore[misc, valid-type]
        def start(self, *state: Sequence[float]) -> None:
            super().start(*state)
            self.last_nm: list[float] | None = None

        def update(self, cycle: Cycle) -> Sequence[float]:
            new_nm = list(super().update(cycle))
            old_nm, self.last_nm = self.last_nm or new_nm, new_nm
            return old_nm

    return Delayed


@pytest.fixture
def late(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in SHIPPED:
        monkeypatch.setitem(LAWS, f"{name}, late", delayed(LAWS[name]))


def errors_lsb(law: str, truth: dict[str, float], trajectory: str, seconds: float) -> np.ndarray:
    """True error of every cycle from the 1024th on, (cycles, joints)."""
    with Rig("konkuk1", law=law, trajectory=trajectory, seed=21, truth=truth) as rig:
        rig.run(seconds=seconds)
        assert rig.state is State.RUNNING, rig.reason
        errors = [joint.true_angle_rad - joint.reference_rad for joint in rig.joints.values()]
    return np.array(errors).T[1024:] / LSB_RAD


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt((errors**2).mean(axis=0)).max())


def test_every_shipped_law_is_tested_here() -> None:
    assert set(SHIPPED) == set(LAWS)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [*MILDER, WORST])
@pytest.mark.parametrize("law", SHIPPED)
def test_errors_do_not_grow_and_one_more_cycle_of_delay_costs_little(law: str, robot: str, late: None) -> None:
    """A loop that is about to diverge swings more and more, and most of all with more delay.

    The trapezoid of both joints repeats after 5.12 s, so that one period can be held against the one before.
    """
    seconds = 2.56 + 2 * 5.12
    errors = errors_lsb(law, ROBOTS[robot], "trapezoid", seconds)
    more_delay = errors_lsb(f"{law}, late", ROBOTS[robot], "trapezoid", seconds)
    for each in (errors, more_delay):
        half = len(each) // 2
        assert rms(each[half:]) < 1.3 * rms(each[:half]) + 0.05
    assert rms(more_delay) < 1.2 * rms(errors) + 0.05


@pytest.mark.slow
@pytest.mark.parametrize("law", ["mras", "mras-lyapunov", "slotine-li"])
def test_nothing_drifts_away_in_the_long_run(law: str) -> None:
    """The sines of the two joints do not repeat together: windows of 10.24 s see most of their phases."""
    errors = errors_lsb(law, ROBOTS["payload +50 %"], "sine", 2.56 + 4 * 10.24)
    first, *_, last = (rms(window) for window in np.split(errors, 4))
    assert last < 1.2 * first + 0.02


@pytest.mark.parametrize("law", ["mras", "mras-lyapunov", "slotine-li"])
def test_what_adapts_stays_bounded_where_the_amplifier_cannot_follow(law: str) -> None:
    """m3 x 3.5 needs 1.579 A to hold, more than the amplifier's 1.5 A; afterwards the payload is taken off again."""
    with Rig("konkuk1", law=law, trajectory="sine", seed=0, truth={"joint3.mass": 2.1}) as rig:
        rig.run(seconds=5.0)
        assert rig.joints["joint2"].saturated_cycles > 0
        rig.change_truth("joint3.mass", 0.6)
        rig.run(seconds=5.0)
        joint = rig.joints["joint2"]
        assert np.abs(joint.true_angle_rad - joint.reference_rad)[-400:].max() < LSB_RAD


def sign_changes_at_rest(law: str, pose_deg: tuple[float, float], folder: Path, truth: dict[str, float]) -> list[int]:
    """How often each joint's commanded current changes its sign in 5 s at rest, 2000 cycles, 2 s after it has come."""
    path = folder / "still.csv"
    start, pose = ("20,0", ",".join(f"{angle_deg:g}" for angle_deg in pose_deg))
    there_s = 1 if pose == start else 3
    path.write_text(f"time_s,joint2,joint3\n0,{start}\n{there_s},{pose}\n{there_s + 1},{pose}\n")
    with Rig("konkuk1", law=law, trajectory=str(path), seed=22, truth=truth) as rig:
        rig.run(seconds=there_s + 2.0 + 5.0)
        assert rig.state is State.RUNNING, rig.reason
        changes = []
        for joint in rig.joints.values():
            assert np.ptp(joint.true_angle_rad[-2000:]) < LSB_RAD
            signs = np.sign(joint.command_a[-2000:])
            signs = signs[signs != 0]
            changes.append(int((signs[1:] != signs[:-1]).sum()))
    return changes


@pytest.mark.slow
@pytest.mark.parametrize("truth", [{}, ROBOTS["payload +50 %"], NOISE_X3], ids=["nominal", "payload", "noise"])
@pytest.mark.parametrize("law", SHIPPED)
def test_a_standing_arm_that_has_weight_to_carry_never_turns_its_bridge_over(
    law: str, truth: dict[str, float], tmp_path: Path
) -> None:
    assert sign_changes_at_rest(law, (20.0, 0.0), tmp_path, truth) == [0, 0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "most"), [({}, 2), (ROBOTS["payload +50 %"], 2), (NOISE_X3, 100)], ids=["nominal", "payload", "noise"]
)
@pytest.mark.parametrize("law", ["computed-torque", "mras-lyapunov", "slotine-li"])
def test_a_hanging_arm_is_held_without_turning_its_bridge_over(
    law: str, truth: dict[str, float], most: int, tmp_path: Path
) -> None:
    """Hanging, no joint needs torque: the sign of the current is noise, unless the torque is held."""
    assert max(sign_changes_at_rest(law, (-90.0, 0.0), tmp_path, truth)) <= most


@pytest.mark.parametrize("law", ["pd", "mras"])
def test_laws_on_raw_measurements_turn_the_bridge_over_where_nothing_weighs(law: str, tmp_path: Path) -> None:
    """As their docstrings say."""
    assert min(sign_changes_at_rest(law, (-90.0, 0.0), tmp_path, {})) > 200
