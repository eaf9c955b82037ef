"""An encoder at a joint or its motor, counted by the counter card and read by the controller."""

import math

import pytest

from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import World
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.cell_file import parse_cell, shipped_cells
from canarm_protocol.cell.model import Cell, Quantity
from canarm_protocol.cell.sensing import joint_sensors

COUNTER = """
[[card]]
name = "counter"
model = "encoder_counter"
robot = "konkuk1"
slot = 5
node_id = 0x15
channel = [{ number = 1, signal = "joint3.encoder" }]
"""


def cell_with(encoder: str) -> Cell:
    """KON-KUK I whose joint 3 has an encoder of 500 lines instead of its potentiometer."""
    before, after = shipped_cells()["konkuk1"].split('name = "joint3"')
    begin, end = after.index("[robot.joint.sensors.potentiometer]"), after.index("[robot.joint.sensors.tachometer]")
    after = after[:begin] + f"[robot.joint.sensors.encoder]\nlines = 500\n{encoder}\n\n" + after[end:]
    after = after.replace('    { number = 2, signal = "joint3.potentiometer" },\n', "")
    return parse_cell(before + 'name = "joint3"' + after + COUNTER, "my.toml")


@pytest.mark.parametrize(
    ("encoder", "counts_per_turn"),
    [("", 2000), ("sign = -1", -2000), ('shaft = "motor"', 80_000)],
    ids=["on the joint", "the other way round", "on the motor, behind a gear of 40"],
)
def test_a_turn_of_the_joint_is_four_counts_a_line_and_the_gear(encoder: str, counts_per_turn: int) -> None:
    position = joint_sensors(cell_with(encoder))[1].position
    assert math.tau / position.scale.step == pytest.approx(counts_per_turn)
    # Joint 3 is parked at 0 degrees, on the edge where the count of 0 begins: it stands for the middle up to the next.
    assert position.scale(0) == pytest.approx(0.5 * math.tau / counts_per_turn)
    assert position.skew_s == 0.0


@pytest.mark.parametrize("wire", ["0", "1"])
def test_it_gives_the_angle_of_its_shaft_at_any_time(wire: str) -> None:
    cell = cell_with('shaft = "motor"')
    world = World(cell, Truth.from_settings(cell, {"joint3.wire": wire}), 0)
    world.set_dac_output(1, 0.5)
    world.set_direction(1, DirectionBits.COUNTER_CLOCKWISE)
    world.advance(50_000_000)
    state = world.state()[1]
    assert world.sample(world.source(1, Quantity.POSITION)) == pytest.approx(40.0 * state.motor_angle_rad)
    assert (state.motor_angle_rad == state.angle_rad) == (wire == "0")


def test_an_encoder_has_no_keys_of_truth() -> None:
    cell = cell_with("")
    assert not [name for name in Truth.from_settings(cell).joints[1].sensors if name.startswith("encoder")]
