"""Error values that the controller writes to the cards as the arms move: which, in what turns, at what traffic."""

import itertools
import math

import pytest

from canarm_controller.dynamics import cell_arm
from canarm_controller.run.carrying import ANSWER_CYCLES, CarryingRefresh
from canarm_protocol.canopen.dictionary import ANALOGUE_ERROR_VALUE, DIGITAL_ERROR_VALUE
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.sdo import AbortCode, abort_request
from canarm_protocol.cell import load_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.schedulability import cell_messages, cell_verdict
from canarm_protocol.cell.wiring import card_nodes

CELL = load_cell("rhino-pair")
HOME = [math.radians(joint.home_deg) for joint in CELL.joints]
UPRIGHT = [math.radians(each) for each in (0.0, -90.0, 0.0, 90.0, 0.0)]
"""Hand above the arm, the tool's axis vertical: no weight has a lever but the hand's offset of 9.5 mm."""


def refresh(cell: Cell = CELL) -> CarryingRefresh:
    return CarryingRefresh(cell, card_nodes(cell), cell_arm(cell.laden, cell.joint_names).gravity)


def answer(request: Frame) -> Frame:
    """A download is accepted: CiA 301, 7.2.4.3.3."""
    return Frame(request.can_id - 0x80, b"\x60" + request.data[1:4] + bytes(4))


def written(carrying: CarryingRefresh, pose: list[float], cycles: int = 200) -> dict[tuple[int, int, int], int]:
    """What the cards are told for a pose, by node, index and sub-index."""
    found = {}
    for tick in range(cycles):
        for request in carrying.frames(tick, pose):
            index, subindex = int.from_bytes(request.data[1:3], "little"), request.data[3]
            size = 4 - (request.data[0] >> 2 & 3)
            found[request.can_id - 0x600, index, subindex] = int.from_bytes(request.data[4 : 4 + size], "little")
            assert carrying.take(answer(request))
    return found


def test_at_home_the_cards_have_what_they_need_already() -> None:
    """The cell's file says 68, 50 and 1 of 255 for the master, 136, 51 and 8 for the slave."""
    assert written(refresh(), HOME) == {}


def test_an_arm_that_stands_upright_needs_no_current() -> None:
    """9.5 mm of 0.35 kg, half of the object and the block come to less than a step of the shoulder, 74 mN m."""
    found = written(refresh(), [*HOME[:5], *UPRIGHT])
    currents = {key[2]: value >> 31 - 8 for key, value in found.items() if key[:2] == (0x21, ANALOGUE_ERROR_VALUE)}
    assert set(currents) == {2, 3, 4}
    assert max(currents.values()) <= 1
    assert not any(node in (0x11, 0x12, 0x13, 0x14) for node, _, _ in found)


def test_what_carries_the_other_way_turns_the_direction() -> None:
    """The slave's shoulder as far behind the vertical as it was before it: the bits are those of the other way."""
    bits = written(refresh(), [*HOME[:5], 0.0, math.radians(-146.5), *HOME[7:]])[0x23, DIGITAL_ERROR_VALUE, 1]
    assert bits >> 2 & 0b11 == 0b10


def test_one_object_is_in_flight_and_one_in_four_cycles() -> None:
    carrying = refresh()
    assert CELL.carry_refresh_cycles == 4
    pose = [*HOME[:5], *UPRIGHT]
    (first,) = carrying.frames(0, pose)
    assert not any(carrying.frames(tick, pose) for tick in range(1, 12))
    assert not carrying.take(Frame(first.can_id - 0x80 + 1, answer(first).data))
    assert carrying.take(answer(first))
    sent = [tick for tick in range(12, 60) for request in carrying.frames(tick, pose) if carrying.take(answer(request))]
    assert min(after - before for before, after in itertools.pairwise(sent)) >= 4


@pytest.mark.parametrize("says", ["nothing", "no"])
def test_a_card_that_does_not_take_a_value_is_asked_again_in_its_turn(says: str) -> None:
    carrying = refresh()
    pose = [*UPRIGHT, *UPRIGHT]
    (refused,) = carrying.frames(0, pose)
    if says == "no":
        code = abort_request(ANALOGUE_ERROR_VALUE, 2, AbortCode.DEVICE_STATE)
        assert carrying.take(Frame(refused.can_id - 0x80, code))
    requests = []
    for tick in range(1, ANSWER_CYCLES + 100):
        for request in carrying.frames(tick, pose):
            requests.append(request)
            carrying.take(answer(request))
    assert requests[0].can_id != refused.can_id
    assert refused in requests


def test_a_joint_in_doubt_is_where_it_was() -> None:
    carrying = refresh()
    assert carrying.frames(0, HOME) == ()
    shoulder = CELL.joint_names.index("slave_shoulder")
    away = [*HOME[:shoulder], 0.0, *HOME[shoulder + 1 :]]
    assert not any(carrying.frames(tick, away, {shoulder}) for tick in range(1, 50))
    assert carrying.frames(60, away)


def test_the_traffic_is_counted() -> None:
    """A request and an answer of eight bytes, 135 bits each, in 10 ms: 2.7 % more; still no frame is late."""
    without = CELL.model_copy(update={"bus": CELL.bus.model_copy(update={"carry_refresh_ms": None})})
    more = cell_verdict(CELL).load - cell_verdict(without).load
    assert more == pytest.approx(2 * 135 / 10_000)
    ids = {each.can_id for each in cell_messages(CELL)} - {each.can_id for each in cell_messages(without)}
    assert ids == {0x591, 0x611}
    assert cell_verdict(CELL).fits
    often = CELL.model_copy(update={"bus": CELL.bus.model_copy(update={"bitrate": 800_000})})
    assert not cell_verdict(often).fits
    assert load_cell("konkuk1").carry_refresh_cycles == 0
