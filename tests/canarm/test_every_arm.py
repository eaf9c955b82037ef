"""Every law on every arm without a fault: nothing is stopped, nothing is accused. `make robots` asks for more seeds."""

from functools import cache
from pathlib import Path

import pytest

from canarm.new_cell import Request, write_cell
from canarm.new_cell.arms import arm_of_urdf, made_up_arm
from canarm.rig.rig import Rig, State
from canarm_controller.laws.loading import LAWS
from canarm_protocol.cell.model import Cell

ARMS = Path(__file__).parents[2] / "examples" / "arms"
LARGE = ("5", "6", "7", "bench_arm")


@cache
def cell_of(name: str) -> Cell:
    arm = made_up_arm(int(name)) if name.isdecimal() else arm_of_urdf(ARMS / f"{name}.urdf", f"{name}.urdf")
    return write_cell(arm, Request(), ARMS)[1]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", ["1", "3", *(pytest.param(name, marks=pytest.mark.slow) for name in LARGE)])
def test_a_run_without_a_fault_is_not_stopped_and_accuses_nothing(name: str, law: str) -> None:
    with Rig(cell_of(name), law, seed=len(law)) as rig:
        rig.run(0.5)
        assert rig.state is State.RUNNING, rig.reason
        assert rig.detections == []
