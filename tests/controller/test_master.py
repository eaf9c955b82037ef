"""What the master leaves configured in the cards, read back by SDO, and how a conversation is driven."""

import struct
from collections.abc import Generator

import pytest

from canarm_controller.bus.master import ANSWER_NS, Ask, Silence, bring_up, read_input, start_frames, stop_frames
from canarm_controller.errors import BringUpError
from canarm_controller.run.state import State
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import Frame, NmtState
from canarm_protocol.canopen.sdo import upload
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.clock import Clock

DAC, LATCH, ADC = 0x12, 0x13, 0x14


def read(bench: FaultBench, node_id: int, index: int, subindex: int = 0) -> int:
    """An object of a card by SDO, unsigned."""
    transfer = upload(index, subindex)
    request = next(transfer)
    while True:
        bench.receive(Frame(0x600 + node_id, request))
        (answer,) = (record.frame.data for record in bench.records if record.frame.can_id == 0x580 + node_id)
        bench.records.clear()
        try:
            request = transfer.send(answer)
        except StopIteration as done:
            return int.from_bytes(done.value, "little")


@pytest.fixture
def configured(pair) -> FaultBench:
    """The bench of a run that was ended as soon as its cards were configured."""
    pair.begin()
    pair.run_until(lambda: pair.controller.state is State.RUNNING)
    pair.controller.outbox.clear()
    pair.bench.records.clear()
    return pair.bench


@pytest.mark.parametrize("node_id", [DAC, LATCH, ADC])
def test_every_card_watches_the_controller_and_shows_itself(configured: FaultBench, node_id: int) -> None:
    # CiA 301, 7.5.2.19: node-ID in bits 16 to 22, time in ms below; the cell says 100 ms, 20 ms and 2500 us.
    assert read(configured, node_id, 0x1016, 1) == 1 << 16 | 100
    assert read(configured, node_id, 0x1017) == 20
    assert read(configured, node_id, 0x1006) == 2500
    assert read(configured, node_id, 0x1029, 1) == 0  # communication error: to PRE-OPERATIONAL


def test_outputs_go_to_zero_on_errors(configured: FaultBench) -> None:
    for channel in range(1, 5):
        assert (read(configured, DAC, 0x6443, channel), read(configured, DAC, 0x6444, channel)) == (1, 0)
    assert (read(configured, LATCH, 0x6206, 1), read(configured, LATCH, 0x6207, 1)) == (0xFF, 0)


@pytest.mark.parametrize(
    ("node_id", "communication", "cob_id", "mapping"),
    [
        (DAC, 0x1401, 0x312, [0x64110110, 0x64110210]),
        (LATCH, 0x1400, 0x213, [0x62000108]),
        (ADC, 0x1801, 0x294, [0x64010110, 0x64010210, 0x64010310, 0x64010410]),
        (ADC, 0x1802, 0x394, [0x64010510, 0x64010610]),
    ],
)
def test_pdos_are_synchronous_and_map_the_wired_channels_only(
    configured: FaultBench, node_id: int, communication: int, cob_id: int, mapping: list[int]
) -> None:
    # COB-IDs of the predefined connection set; mapping entries are index, sub-index and bits.
    assert read(configured, node_id, communication, 1) & 0x8000_07FF == cob_id
    assert read(configured, node_id, communication, 2) == 1
    table = communication + 0x200
    assert read(configured, node_id, table, 0) == len(mapping)
    assert [read(configured, node_id, table, place) for place in range(1, len(mapping) + 1)] == mapping


def test_every_card_starts_and_stops_by_its_own_node_id() -> None:
    nodes = card_nodes(load_cell("konkuk1"))
    assert start_frames(nodes, 1) == [
        Frame(0x701, b"\x05"),
        *[Frame(0, bytes((0x01, node_id))) for node_id in (DAC, LATCH, ADC)],
    ]
    assert stop_frames(nodes) == [
        Frame(0, bytes((command, node_id))) for command in (0x02, 0x80) for node_id in (DAC, LATCH, ADC)
    ]


def answer_to(conversation: Generator[Ask, Frame, object], frame: Frame) -> Ask:
    return conversation.send(frame)


def test_each_ask_names_whom_it_waits_for_and_how_long() -> None:
    cell = load_cell("konkuk1")
    conversation = bring_up(card_nodes(cell), cell.bus, clock_mode=1, listen_ns=250_000_000)
    ask = next(conversation)
    assert (ask.frames, ask.limit_ns, ask.awaited) == ((), 250_000_000, "another controller")
    ask = conversation.throw(Silence())
    assert ask.frames == (Frame(0, bytes((0x81, DAC))),)
    assert (ask.limit_ns, ask.awaited) == (ANSWER_NS, "card 'dac' (node 0x12)")
    assert ask.is_answer(Frame(0x712, bytes((NmtState.BOOT_UP,))))
    for other in (Frame(0x712, b"\x7f"), Frame(0x713, b"\x00"), Frame(0x592, bytes(8)), Frame(0x712, b"")):
        assert not ask.is_answer(other)


def test_nobody_on_the_bus_is_told_with_a_hint() -> None:
    cell = load_cell("konkuk1")
    conversation = bring_up(card_nodes(cell), cell.bus, clock_mode=1, listen_ns=0)
    next(conversation)
    with pytest.raises(
        BringUpError, match=r"no boot-up within 3 s of NMT reset; is an emulator with this cell on this bus"
    ):
        conversation.throw(Silence())


def test_a_card_that_is_missing_where_others_answer_may_be_one_of_another_cell() -> None:
    cell = load_cell("konkuk1")
    bench = FaultBench(cell, Truth.from_settings(cell, {}), Clock.SYNC, seed=0)
    bench.start()
    (elsewhere,) = (node for node in card_nodes(load_cell("rhino-pair")) if node.card.node_id == 0x22)
    conversation = bring_up((card_nodes(cell)[0], elsewhere), cell.bus, clock_mode=1, listen_ns=0)

    def talk() -> None:
        ask = next(conversation)
        while True:
            bench.records.clear()
            for frame in ask.frames:
                bench.receive(frame)
            answer = next((record.frame for record in bench.records if ask.is_answer(record.frame)), None)
            ask = conversation.throw(Silence()) if answer is None else conversation.send(answer)

    with pytest.raises(BringUpError, match=r"node 0x22\) does not answer: .*; card 'dac' .* does: .*another cell\?"):
        talk()


@pytest.mark.parametrize("code", [0, 1, 127, 255])
def test_an_input_is_read_as_its_eight_bit_code(code: int) -> None:
    (adc,) = (node for node in card_nodes(load_cell("konkuk1")) if node.card.node_id == ADC)
    reading = read_input(adc, 3)
    ask = next(reading)
    assert ask.frames == (Frame(0x614, b"\x40\x01\x64\x03" + bytes(4)),)
    with pytest.raises(StopIteration) as done:
        reading.send(Frame(0x594, b"\x4b\x01\x64\x03" + struct.pack("<hH", code << 7, 0)))
    assert done.value.value == code


def test_an_answer_about_another_object_is_refused() -> None:
    (adc,) = (node for node in card_nodes(load_cell("konkuk1")) if node.card.node_id == ADC)
    reading = read_input(adc, 3)
    next(reading)
    abort = reading.send(Frame(0x594, b"\x4b\x01\x64\x04" + bytes(4)))
    assert [(frame.can_id, frame.data[0]) for frame in abort.frames] == [(0x614, 0x80)]  # CiA 301, 7.2.4.3.17
    with pytest.raises(BringUpError, match=r"card 'adc' \(node 0x14\): SDO 0x6401:03 aborted by the client"):
        reading.throw(Silence())
