"""A user's own cell, of another timing, resolution, sign, offset or home pose, runs, or the arithmetic says why not."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from canarm.new_cell import NewCellError, Request, write_cell
from canarm.new_cell.arms import made_up_arm
from canarm.rig.rig import Rig, State
from canarm_protocol.cell.cell_file import parse_cell
from canarm_protocol.cell.model import Cell

RUN_S = 1.2
"""The reference has left the home pose by then, at up to 1.5 rad/s."""
MOST_ERROR_DEG = 1.5
"""A step of an 8-bit sensor is about as much; a loop with a wrong sign is off by tens of degrees."""


@cache
def text_of(joint_count: int, request: Request) -> str:
    return write_cell(made_up_arm(joint_count), request, Path())[0]


def cell_of(*changes: tuple[str, str], joint_count: int = 1, request: Request | None = None) -> Cell:
    """The cell of a new arm with texts replaced by others, wherever they stand."""
    text = text_of(joint_count, request or Request())
    for old, new in changes:
        assert re.search(old, text), old
        text = re.sub(old, new, text)
    return parse_cell(text, "mine.toml")


def follows(cell: Cell, law: str = "mras") -> None:
    with Rig(cell, law) as rig:
        rig.run(RUN_S)
        assert rig.state is State.RUNNING, rig.reason
        assert not rig.detections
        for joint in rig.joints.values():
            astray = np.degrees(np.max(np.abs(joint.true_angle_rad - joint.reference_rad)))
            assert astray < MOST_ERROR_DEG, f"{joint.name} is off by {astray:.2f} degrees"
            moved = np.degrees(np.ptp(joint.true_angle_rad))
            assert moved > 5.0, f"{joint.name} moved by {moved:.2f} degrees only"


@pytest.mark.parametrize("cycle_us", [1000, 2000, 5000, 10_000])
def test_another_cycle_time(cycle_us: int) -> None:
    follows(cell_of(request=Request(cycle_us=cycle_us)))


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_another_resolution(bits: int) -> None:
    follows(cell_of(request=Request(bits=bits)))


@pytest.mark.parametrize(
    ("bitrate", "cycle_us"), [(1_000_000, 2500), (500_000, 2500), (250_000, 3000), (125_000, 5000)]
)
def test_another_bit_rate_gets_a_cycle_that_it_can_carry(bitrate: int, cycle_us: int) -> None:
    cell = cell_of(request=Request(bitrate=bitrate))
    assert cell.bus.cycle_us == cycle_us
    follows(cell)


def test_a_cycle_that_the_bit_rate_cannot_carry_is_refused_with_the_arithmetic() -> None:
    with pytest.raises(NewCellError, match=r"125000 bit/s x 1000 us = 125 bits per cycle"):
        cell_of(request=Request(cycle_us=1000, bitrate=125_000))


@pytest.mark.parametrize("sensor", ["potentiometer", "tachometer"])
def test_a_sensor_that_is_mounted_the_other_way_round(sensor: str) -> None:
    follows(cell_of((rf"(\[robot.joint.sensors.{sensor}\]\n)", r"\1sign = -1\n")))


def test_a_joint_that_turns_the_other_way_round() -> None:
    follows(cell_of((r"axis = \[0.0, -1.0, 0.0\]", "axis = [0.0, 1.0, 0.0]")))


def test_another_home_pose() -> None:
    follows(cell_of((r"home_deg = 20.0", "home_deg = -45.0")))


def test_a_sensor_whose_zero_is_elsewhere() -> None:
    follows(
        cell_of((r"range_deg = \d+\.\d", "range_deg = 300.0"), (r"zero_v = 2.5 (.*at 0 degrees)", r"zero_v = 2.9 \1"))
    )


def test_limits_to_one_side_of_zero() -> None:
    follows(
        cell_of(
            (r"limits_deg = .*", "limits_deg = [10.0, 150.0]"),
            (r"home_deg = .*", "home_deg = 80.0"),
            (r"range_deg = \d+\.\d", "range_deg = 180.0"),
            (r"zero_v = 2.5 (.*at 0 degrees)", r"zero_v = 0.0 \1"),
        )
    )


def test_joints_without_tachometer_or_current_sense() -> None:
    follows(cell_of(joint_count=2, request=Request(sensing=("potentiometer",))))


@pytest.mark.parametrize("law", ["pd", "computed-torque", "mras", "mras-lyapunov", "slotine-li"])
def test_every_law_runs_an_arm_of_three_joints(law: str) -> None:
    with Rig(cell_of(joint_count=3), law) as rig:
        rig.run(0.5)
        assert rig.state is State.RUNNING, rig.reason
