"""The object on its stand: empty hands are homed, close when an output of a card tells them to, and carry it away."""

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from canarm import Rig, State
from canarm_protocol.cell import load_cell, parse_cell, shipped_cells
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import HandBits, card_nodes
from canarm_protocol.errors import CellError

sys.path.append(str(Path(__file__).parent.parent.parent / "scripts"))
start = importlib.import_module("carrying_start")
CELL = load_cell("rhino-pair", {"object.on_stand": "true"})
CONTROL = CELL.control.model_copy(update={"homing": None})
QUICK = CELL.model_copy(
    update={"control": CONTROL, "object": CELL.object.model_copy(update={"closing_s": 0.1, "taken_up_s": 0.1})}
)
"""Known where it is parked, and with quick hands."""


def told(rig: Rig) -> list[tuple[float, HandBits]]:
    """What the master's hand was told last, frame by frame: s, bits."""
    (layout,) = (node.rpdos[0] for node in card_nodes(rig.cell) if node.card.name == "master-latch2")
    return [
        (each.time_ns * 1e-9, HandBits(each.frame.data[0] >> 2 & 0b11))
        for each in rig.frames
        if each.frame.can_id == layout.cob_id
    ]


@pytest.mark.parametrize("law", ["mras", pytest.param("slotine-li", marks=pytest.mark.slow)])
def test_hands_close_where_they_rest_and_the_path_follows(law: str) -> None:
    with Rig(QUICK, law) as rig:
        rig.run(seconds=0.9)
        assert rig.controller.is_empty
        assert rig.object.state.is_on_stand
        assert not rig.object.is_held
        rig.run(seconds=1.0)
        assert not rig.controller.is_empty
        assert rig.object.is_held
        assert rig.object.grip_force_n.max() < rig.object.slip_force_n / 2
        assert rig.state is State.RUNNING
        assert not rig.detections
        bits = told(rig)
    closes = [time_s for time_s, each in bits if each is HandBits.CLOSE]
    keeps = [time_s for time_s, each in bits if each is HandBits.KEEP]
    # After the move of 0.5 s and a rest of 0.4 s, until the stand has sunk.
    assert closes[0] == pytest.approx(0.9, abs=0.01)
    assert closes[-1] == pytest.approx(1.1, abs=0.01)
    assert not [time_s for time_s in keeps if closes[0] < time_s < closes[-1]]


@pytest.mark.slow
def test_a_hand_whose_output_fails_loses_the_object() -> None:
    """The bit that opens is always 1; the screw needs a fifth of 0.1 s to lift the pads off."""
    with Rig(QUICK, "mras") as rig:
        rig.inject("slave_roll.grip", "latch-bit-stuck", at=1.6, bit=1, value=1)
        rig.run(seconds=1.61)
        assert rig.object.is_held
        rig.run(seconds=0.03)
        assert rig.object.state.lost == ("slave",)
        assert [event.detail for event in rig.events if event.event == "grip-lost"] == ["slave"]


@pytest.mark.slow
def test_hands_that_are_not_told_leave_the_object_on_its_stand() -> None:
    with Rig(QUICK, "mras") as rig:
        rig.inject("master_roll.grip", "latch-bit-stuck", at=0.0, bit=0, value=0)
        rig.run(seconds=1.6)
        assert rig.object.state.is_on_stand
        assert rig.object.state.lost == ()
        assert not rig.object.is_held


@pytest.mark.slow
def test_torques_change_evenly_when_the_hands_have_closed() -> None:
    """Over the cycle in which another loop takes over, and while the stand sinks: by no more than before it."""
    with Rig(QUICK, "mras-lyapunov") as rig:
        rig.run(seconds=1.6)
        steps = [np.abs(np.diff(joint.command_a)) for joint in rig.joints.values()]
        taken = round(0.9 / 0.0025) + 42
    for each in steps:
        assert each[taken - 8 : taken + 40].max() < max(2.0 * each[200 : taken - 8].max(), 0.02)


@pytest.mark.slow
@pytest.mark.parametrize("seed", ["start test/0", "start test/1"])
@pytest.mark.parametrize(
    ("cell", "begins_with"),
    [
        pytest.param(CELL, ["the hands are empty", "the hands close"], id="from a stand"),
        pytest.param(load_cell("rhino-pair"), ["the supports let go", "homing"], id="in the hands"),
    ],
)
def test_the_object_is_taken_up_without_a_jerk(cell: Cell, begins_with: list[str], seed: str) -> None:
    """Less than the object's weight, heaviest drawn, comes into the hands within 10 ms: 0.6 kg, 5.9 N."""
    rig, _ = start.parked_rig(cell, seed)
    found = start.parts(rig)
    assert rig.state is State.RUNNING, rig.reason
    assert not rig.detections
    assert rig.object.is_held
    assert [each.part for each in found][:2] == begins_with
    assert max(each.rise_n for each in found) < 1.5 * cell.object.mass_kg * 9.81
    assert max(each.grip_n for each in found) < rig.object.slip_force_n / 2
    assert max(each.squeeze_n for each in found) < 4.0


def refused(old: str, new: str) -> str:
    text = shipped_cells()["rhino-pair"].replace("on_stand = false", "on_stand = true")
    assert text.count(old) >= 1
    with pytest.raises(CellError) as told_why:
        parse_cell(text.replace(old, new, 1), "pair")
    return str(told_why.value)


def test_a_stand_needs_hands_that_are_wired() -> None:
    line = '    { number = 2, signal = "roll.grip" },          # of the hand\n'
    assert "object.on_stand = true: master_roll.grip is not wired; a channel of card model sc300" in refused(line, "")


def test_a_hand_is_at_the_end_of_a_robot_that_carries() -> None:
    why = refused('signal = "roll.grip"', 'signal = "pitch.grip"')
    assert re.search(r'signal = "pitch.grip": must be master_roll.grip or slave_roll.grip', why)
    text = shipped_cells()["konkuk1"]
    latch = '{ number = 2, signal = "joint3.direction" },'
    with pytest.raises(CellError, match="no robot of this cell carries an object; leave it out"):
        parse_cell(text.replace(latch, f'{latch}\n    {{ number = 3, signal = "joint3.grip" }},'), "konkuk1")


def carried(cell: Cell) -> bool:
    return cell.object is not None and cell.object.on_stand


def test_the_pair_begins_with_the_object_in_its_hands_unless_told() -> None:
    assert not carried(load_cell("rhino-pair"))
    assert carried(CELL)
