"""A motor, gear, sensor or joint that is mounted the other way round works as any other, and is told where it is not.

The same arm with other wires: what is compared with the reversed robot is the one that is not.
"""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from canarm.jogging.cards import output_text
from canarm.jogging.parsing import Drive, Parser
from canarm.new_cell import Request, write_cell
from canarm.new_cell.arms import made_up_arm
from canarm.rig import rig as rig_module
from canarm.rig.rig import Rig, State
from canarm.session import make_bench
from canarm_protocol.cell.cell_file import parse_cell, shipped_cells
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import DirectionBits, card_nodes
from canarm_protocol.errors import CellError

RUN_S = 3.0
MOST_WORSE_DEG = 0.1
"""A tenth of a step of an 8-bit potentiometer; a loop with a wrong sign is off by tens of degrees."""
LATCH_RPDO = 0x213
"""Of konkuk1: the directions of its joints."""

PARTS = {
    "none": (),
    "motor": ((r"(\[robot.joint.motor\].*\n)", r"\1sign = -1\n"),),
    "gear": (("gear_ratio = ", "gear_ratio = -"),),
    "motor and gear": (("gear_ratio = (.*)", r"gear_ratio = -\1\nsign = -1"),),
    "potentiometer": ((r"(sensors.potentiometer\]\n)", r"\1sign = -1\n"),),
    "range of the potentiometer": (("range_deg = ", "range_deg = -"),),
    "tachometer": ((r"(sensors.tachometer\]\n)", r"\1sign = -1\n"),),
    "constant of the tachometer": (("full_scale_rad_s = ", "full_scale_rad_s = -"),),
    "encoder": ((r"(sensors.encoder\]\n)", r"\1sign = -1\n"),),
}
ON_THE_MOTOR = (("counter_bits = 16", "counter_bits = 32"), ('shaft = "joint"', 'shaft = "motor"'))
"""A motor's encoder counts 60 times as fast: 16 bits would wrap within the travel."""


@cache
def text_of(arm: str) -> str:
    """The cell of konkuk1, or of a new arm of three joints with a position sensor of the kind in brackets."""
    if arm == "konkuk1":
        return shipped_cells()["konkuk1"]
    position = "encoder" if "encoder" in arm else "potentiometer"
    request = Request(sensing=(position, "tachometer", "current_sense"))
    text = write_cell(made_up_arm(3), request, Path())[0]
    return changed(text, ON_THE_MOTOR) if arm == "three (encoder on the motor)" else text


def changed(text: str, changes: tuple[tuple[str, str], ...], count: int = 0) -> str:
    for old, new in changes:
        assert re.search(old, text), old
        text = re.sub(old, new, text, count=count)
    return text


def cell_of(arm: str, part: str = "none", count: int = 0) -> Cell:
    """The cell with the `part` of all joints reversed, or of the first `count`."""
    return parse_cell(changed(text_of(arm), PARTS[part], count), "mine.toml")


@cache
def errors_deg(arm: str, part: str, law: str) -> dict[str, float]:
    """RMS of the true error of each joint in a run that must raise nothing."""
    with Rig(cell_of(arm, part), law) as rig:
        rig.run(RUN_S)
        assert rig.state is State.RUNNING, rig.reason
        assert not rig.detections
        return {
            name: float(np.degrees(np.sqrt(np.mean((joint.true_angle_rad - joint.reference_rad) ** 2))))
            for name, joint in rig.joints.items()
        }


@pytest.mark.parametrize("law", ["mras", *(pytest.param(law, marks=pytest.mark.slow) for law in ("pd", "slotine-li"))])
@pytest.mark.parametrize(
    ("arm", "part"),
    [
        ("konkuk1", "motor"),
        ("konkuk1", "potentiometer"),
        ("three", "gear"),
        ("three (encoder)", "motor"),
        ("three (encoder)", "encoder"),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in (
                ("konkuk1", "constant of the tachometer"),
                ("three", "range of the potentiometer"),
                ("three", "tachometer"),
                ("three (encoder on the motor)", "gear"),
                ("three (encoder on the motor)", "encoder"),
            )
        ),
    ],
)
def test_a_reversed_part_is_followed_as_well_as_any_other(arm: str, part: str, law: str) -> None:
    usual, found = errors_deg(arm, "none", law), errors_deg(arm, part, law)
    for joint, error_deg in found.items():
        assert error_deg < usual[joint] + MOST_WORSE_DEG, f"{joint}: {error_deg:.3f}, not {usual[joint]:.3f} degrees"


@pytest.mark.slow
@pytest.mark.parametrize("law", ["computed-torque", "mras-lyapunov"])
def test_the_other_laws_follow_with_a_reversed_motor_too(law: str) -> None:
    errors_deg("konkuk1", "motor", law)


def test_a_reversed_drive_changes_the_direction_bits_and_nothing_else_on_the_bus() -> None:
    logs = []
    for part in ("none", "motor", "gear", "motor and gear"):
        with Rig(cell_of("konkuk1", part)) as rig:
            rig.run(1.0)
            logs.append([(each.frame.can_id, bytes(each.frame.data)) for each in rig.frames])
    usual, *reversed_once, both = logs
    assert both == usual
    swapped = [
        (can_id, bytes((byte & 0x55) << 1 | byte >> 1 & 0x55 for byte in data)) if can_id == LATCH_RPDO else each
        for each in usual
        for can_id, data in (each,)
    ]
    assert swapped != usual
    assert reversed_once == [swapped, swapped]


@pytest.mark.parametrize("law", ["mras", "slotine-li"])
def test_a_joint_with_a_link_that_counts_the_other_way(law: str) -> None:
    text = text_of("konkuk1").replace("home_deg = 20.0", "home_deg = -20.0")
    text = text.replace("d_m = 0.0\n", "d_m = 0.0\nsign = -1\n")
    usual = errors_deg("konkuk1", "none", law)
    with Rig(parse_cell(text, "mine.toml"), law) as rig:
        rig.run(RUN_S)
        assert rig.state is State.RUNNING, rig.reason
        assert not rig.detections
        for name, joint in rig.joints.items():
            error_deg = np.degrees(np.sqrt(np.mean((joint.true_angle_rad - joint.reference_rad) ** 2)))
            assert error_deg < usual[name] + MOST_WORSE_DEG


@pytest.mark.parametrize(
    ("arm", "part", "named", "words"),
    [
        ("konkuk1", "motor", "saturation", "moving against its current"),
        ("three", "gear", "saturation", "moving against its current"),
        ("konkuk1", "potentiometer", "potentiometer-mismatch", "from the integrated tachometer"),
        ("three", "tachometer", "tachometer-mismatch", ""),
        ("three (encoder)", "encoder", "encoder-jump", "from the integrated tachometer"),
    ],
)
def test_a_robot_whose_part_is_reversed_unknown_to_the_controller_is_noticed(
    monkeypatch: pytest.MonkeyPatch, arm: str, part: str, named: str, words: str
) -> None:
    other = cell_of(arm, part, count=1)
    monkeypatch.setattr(rig_module, "make_bench", lambda _, *arguments: make_bench(other, *arguments))
    with Rig(cell_of(arm)) as rig:
        rig.run(1.0)
        first = rig.noticed[0]
        assert (first.detection.detector, first.detection.where) == (named, rig.cell.joint_names[0])
        assert words in first.detection.detail
        assert first.time_s < 0.5


@pytest.mark.parametrize(
    ("tap", "fault", "named"),
    [
        ("joint2.motor", "open-load", "current-mismatch"),
        ("joint2.latch", "reversed-direction", "wrong-direction"),
        ("joint2.potentiometer", "stuck", "potentiometer-stuck"),
        ("joint2.tachometer", "stuck", "tachometer-stuck"),
        ("joint2.current_sense", "dropout", "current-sense-range"),
    ],
)
def test_what_breaks_on_a_robot_with_every_part_reversed_gets_its_usual_name(tap: str, fault: str, named: str) -> None:
    text = text_of("konkuk1")
    for part in ("motor", "potentiometer", "tachometer"):
        text = changed(text, PARTS[part])
    with Rig(parse_cell(text, "mine.toml")) as rig:
        rig.inject(tap, fault, at=1.0)
        rig.run(2.0)
        assert rig.detected(named, "joint2")


@pytest.mark.parametrize(
    ("old", "new", "answer"),
    [
        ("gear_ratio = 60.0", "gear_ratio = 0.0", "must not be 0"),
        ("torque_constant_nm_a = 0.08", "torque_constant_nm_a = -0.08", "motor.sign = -1 turns a motor round"),
        ("range_deg = 270.0", "range_deg = -270.0\nsign = -1", "turns the sensor round, and so does sign = -1"),
        ("full_scale_a = 1.5", "full_scale_a = -1.5", "the sense shows no sign"),
    ],
)
def test_a_sign_that_cannot_be_meant_is_refused_with_what_would_be_right(old: str, new: str, answer: str) -> None:
    with pytest.raises(CellError, match=re.escape(answer)):
        parse_cell(text_of("konkuk1").replace(old, new), "mine.toml")


def test_a_counter_that_wraps_round_within_the_travel_is_refused_with_the_arithmetic() -> None:
    text = changed(text_of("three (encoder)"), ON_THE_MOTOR[1:])
    # 360 degrees / (2048 lines x 4 edges x 60 turns) x 2^15 codes either way = 24 degrees
    with pytest.raises(CellError, match=r"'waist'.limits_deg = \[-150, 150\]: .* show -24 to 24 degrees"):
        parse_cell(text, "mine.toml")


def test_jogging_a_reversed_drive_by_current_turns_the_joint_the_way_that_is_asked_for() -> None:
    cell = cell_of("konkuk1", "motor")
    drive = Parser(cell, card_nodes(cell)).parse("current joint2 0.5")
    assert isinstance(drive, Drive)
    assert drive.direction is DirectionBits.CLOCKWISE
    assert output_text(cell, 0, drive.code, drive.direction) == "joint2: code 85, cw, 0.500 A"


def test_a_new_cell_says_how_a_reversed_part_is_written() -> None:
    assert "mounted the other way round: sign = -1" in text_of("three")
