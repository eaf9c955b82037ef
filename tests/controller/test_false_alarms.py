"""Fault-free runs of every law and motion, drawn over seeds and payloads: nothing is detected."""

import runpy
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from canarm import Rig, State
from canarm_controller.dynamics import Arm
from canarm_controller.laws import ControlLaw, Cycle
from canarm_protocol.cell.model import Control

SCRIPT = Path(__file__).parents[2] / "scripts" / "false_alarms.py"
RUNS = 20


def test_twenty_runs_without_a_fault_raise_no_alarm() -> None:
    script = runpy.run_path(str(SCRIPT))
    drawn = script["draws"](RUNS, seed=1)
    assert {draw.law for draw in drawn} == set(script["LAWS"])
    assert {(draw, *alarms) for draw in drawn for _, alarms in [script["run"](draw)] if alarms} == set()


class _Late(ControlLaw):
    """Nothing for a second, then it holds the pose that it began at."""

    name = "late"

    def __init__(self, arm: Arm, control: Control, period_s: float) -> None:
        self._arm, self._period_s = arm, period_s

    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        self._pose, self._sum, self._cycles = list(position_rad), [0.0] * len(position_rad), 0

    def update(self, cycle: Cycle) -> Sequence[float]:
        self._cycles += 1
        if self._cycles < 400:
            return [0.0] * len(self._pose)
        off = [pose - position for pose, position in zip(self._pose, cycle.position_rad, strict=True)]
        self._sum = [total + self._period_s * each for total, each in zip(self._sum, off, strict=True)]
        rows = zip(
            self._arm.gravity(self._pose),
            self._arm.effective_inertia,
            off,
            cycle.velocity_rad_s,
            self._sum,
            strict=True,
        )
        return [weight + j * (144.0 * x - 24.0 * v + 600.0 * z) for weight, j, x, v, z in rows]


def test_a_law_that_asks_for_nothing_leaves_the_arm_on_its_support_and_that_is_no_fault() -> None:
    with Rig(law=lambda cycle: [0.0] * len(cycle.position_rad)) as rig:
        rig.run(3.0)
        assert rig.state is State.RUNNING, rig.reason
        assert not rig.detections
        assert np.ptp(rig.joints["joint2"].true_angle_rad) == 0.0


@pytest.mark.parametrize("mass_kg", [0.3, 0.6, 0.9])
def test_a_law_that_takes_the_arm_up_late_meets_no_alarm(mass_kg: float) -> None:
    with Rig(law=_Late, truth={"joint3.mass": mass_kg}) as rig:
        rig.run(2.0)
        assert rig.state is State.RUNNING, rig.reason
        assert not rig.detections
