"""What rings faster than the cell's longest step can follow is integrated in shorter ones, not refused."""

import math

import pytest

from canarm_emulator.robot.plant import Plant
from canarm_emulator.robot.scan_schedule import ScanSchedule
from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import World
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Quantity

CELL = load_cell("konkuk1")
ONE = CELL.model_copy(update={"robot": (CELL.robot[0].model_copy(update={"joint": CELL.joints[:1]}),)})
LINK_INERTIA, ROTOR_INERTIA = 0.18**2 / 3, 0.054
STIFF_AND_LIGHT = {"joint3.wire": "1", "joint3.wire_stiffness": "5000", "joint3.mass": "0.01"}


def test_a_wire_rings_at_the_root_of_stiffness_over_both_inertias() -> None:
    plant = Plant(ONE, Truth.from_settings(ONE, {"joint2.wire": "1"}))
    assert plant.fastest_rad_s == pytest.approx(math.sqrt(200 * (1 / LINK_INERTIA + 1 / ROTOR_INERTIA)), rel=1e-9)
    assert plant.compliance == pytest.approx([1 / ROTOR_INERTIA])
    rigid = Plant(ONE, Truth.from_settings(ONE))
    assert rigid.fastest_rad_s == 0.0
    assert rigid.compliance == pytest.approx([1 / (LINK_INERTIA + ROTOR_INERTIA)])


@pytest.mark.parametrize(
    "settings",
    [STIFF_AND_LIGHT, {"joint2.torque_constant": "1", "joint2.winding_ohm": "0.1"}],
    ids=["a stiff wire on a light link", "a motor that brakes hard"],
)
def test_what_is_too_fast_for_the_cells_step_does_not_diverge(settings: dict[str, str]) -> None:
    world = World(CELL, Truth.from_settings(CELL, settings), 0)
    for joint in (0, 1):
        world.set_dac_output(joint, 0.3)
        world.set_direction(joint, DirectionBits.COUNTER_CLOCKWISE)
    world.advance(200_000_000)
    assert all(abs(state.speed_rad_s) < 20.0 for state in world.state())


def test_a_scan_goes_on_in_shorter_steps_when_a_wire_turns_elastic() -> None:
    world = World(CELL, Truth.from_settings(CELL), 0)
    world.set_direction(0, DirectionBits.COUNTER_CLOCKWISE)
    schedule = ScanSchedule.merged([([world.source(0, Quantity.POSITION)] * 6, 100_000)])
    assert len(world.scan(schedule)) == 6
    world.change(Truth.from_settings(CELL, STIFF_AND_LIGHT))
    assert len(world.scan(schedule)) == 6
    world.change(Truth.from_settings(CELL))
    assert len(world.scan(schedule)) == 6
    assert world.time_ns == 3 * 600_000
