"""The encoder counter: decoding, wrapping, index and flags by its registers, then CiA 406 with python-canopen."""

import io
from math import tau
from typing import Any

import canopen
import pytest

from canarm_emulator.cards.encoder_counter import (
    CLEAR,
    COUNT,
    FLAGS,
    INDEX,
    INDEX_PASSED,
    WENT_OVER,
    WENT_UNDER,
    CounterDevice,
    EncoderCounterCard,
)
from canarm_emulator.node.slave import Slave
from canarm_protocol.canopen.dictionary import eds_text, load_dictionary
from canarm_protocol.canopen.frames import Frame, NmtCommand
from canarm_protocol.cards import KINDS
from canarm_protocol.cell.model import CARD_TYPES

LINES = 500
NODE_ID = 0x16


class PowerOn:
    """A clock that stands at power-on."""

    time_ns = 0


class Shaft:
    """Four shafts that are turned by hand, and a card on them."""

    def __init__(self, bits: int = 32, decoding: int = 4) -> None:
        self.turns = [0.0] * 4
        self.card = EncoderCounterCard(lambda c: self.turns[c] * tau, lambda channel: LINES, bits, decoding)
        for channel in range(4):
            self.card.write(4 * channel, 0, 0)

    def latched(self, channel: int, what: int) -> int:
        self.card.write(4 * channel + what, 0, 0)
        return int.from_bytes((self.card.read(4 * channel + byte, 0) for byte in range(4)), "little", signed=True)

    def count_at(self, turns: float, channel: int = 0) -> int:
        self.turns[channel] = turns
        return self.latched(channel, COUNT)


@pytest.mark.parametrize(("decoding", "edges_per_turn"), [(1, 500), (4, 2000)])
def test_one_edge_of_a_period_is_counted_or_all_four(decoding: int, edges_per_turn: int) -> None:
    """500 periods a turn give 500 counts with x1 and 2000 with x4 decoding."""
    shaft = Shaft(decoding=decoding)
    quarter_period = 0.25 / LINES
    assert shaft.count_at(1.0 + quarter_period / 2) == edges_per_turn
    assert shaft.count_at(1.0 + 1.5 * quarter_period) == edges_per_turn + (decoding == 4)
    assert shaft.count_at(-2.0 + quarter_period / 2) == -2 * edges_per_turn
    assert shaft.count_at(1.0, channel=3) == edges_per_turn
    assert shaft.latched(1, COUNT) == 0


def test_a_counter_of_16_bits_wraps_around_and_says_which_way() -> None:
    """-32768 to 32767: 17 turns of 2000 counts are 34000, which reads 34000 - 65536."""
    shaft = Shaft(bits=16)
    assert shaft.count_at(17.0) == 34_000 - 65_536
    assert shaft.latched(0, FLAGS) & (WENT_OVER | WENT_UNDER) == WENT_OVER
    assert shaft.card.channels[0].overflows == 1
    assert shaft.count_at(0.0) == 0
    assert shaft.latched(0, FLAGS) & (WENT_OVER | WENT_UNDER) == WENT_UNDER
    assert shaft.card.channels[0].overflows == 0
    assert shaft.latched(0, FLAGS) == 0


def test_a_counter_of_32_bits_goes_on() -> None:
    assert Shaft(bits=32).count_at(17.0) == 34_000


def test_the_index_latches_the_count_at_the_turn_that_was_passed_from_either_side() -> None:
    shaft = Shaft()
    shaft.count_at(0.9)
    assert shaft.latched(0, FLAGS) & INDEX_PASSED == 0
    shaft.count_at(1.3)
    assert shaft.latched(0, INDEX) == 2000
    assert shaft.latched(0, FLAGS) & INDEX_PASSED
    shaft.count_at(0.7)
    assert shaft.latched(0, INDEX) == 2000
    shaft.latched(0, CLEAR)
    shaft.count_at(1.1)
    assert shaft.latched(0, INDEX) == 600  # 0.3 turns above the 0 that was set at 0.7


def test_at_power_on_the_counter_is_0_wherever_the_shaft_stands() -> None:
    card = EncoderCounterCard(lambda channel: 12.3, lambda channel: LINES, 32, 4)
    card.write(COUNT, 0, 0)
    assert [card.read(byte, 0) for byte in range(4)] == [0, 0, 0, 0]


class Link(canopen.Network):
    """python-canopen, answered by one node at once."""

    def __init__(self) -> None:
        super().__init__()
        self.turns = [0.0] * 4
        card_type = CARD_TYPES["encoder_counter"]
        card = card_type(name="c", model="encoder_counter", robot="r", slot=6, node_id=NODE_ID, channel=(_channel(),))
        registers = EncoderCounterCard(lambda c: self.turns[c] * tau, lambda channel: LINES, card.codec.bits, 4)
        self.device = CounterDevice(registers, PowerOn())
        dictionary = load_dictionary("encoder_counter", NODE_ID)
        self.sent: list[Frame] = []
        self.slave = Slave("counter", NODE_ID, dictionary, self.device, lambda _, frame: self.sent.append(frame), 1)
        self.slave.boot(0)

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        self.sent.clear()
        self.slave.on_sdo(can_id, bytes(data), 0)
        for frame in self.sent:
            self.notify(frame.can_id, bytearray(frame.data), 0.0)

    def counter(self) -> canopen.RemoteNode:
        eds = io.StringIO(eds_text("encoder_counter"))
        eds.name = "encoder_counter.eds"
        return self.add_node(NODE_ID, eds)


def _channel() -> dict[str, Any]:
    return {"number": 1, "signal": "waist.encoder"}


def test_it_is_a_multi_sensor_encoder_of_cia_406() -> None:
    """0x1000: profile 406, 0x0A for a multi-sensor encoder interface; positions are 0x6020, presets 0x6010."""
    link = Link()
    counter = link.counter()
    assert counter.sdo[0x1000].raw == 0x000A_0196
    link.turns[1] = 0.5
    assert counter.sdo["Position values for multi-sensor devices"][2].raw == 0  # the first look
    link.turns[1] = 1.25
    assert counter.sdo[0x6020][2].raw == 1500
    assert counter.sdo["Count at the last index"][2].raw == 1000
    assert counter.sdo["Index pulses"][2].raw == 1
    counter.sdo[0x6010][2].raw = -7
    assert counter.sdo[0x6020][2].raw == -7
    link.turns[1] = 0.75
    assert counter.sdo[0x6020][2].raw == -1007
    assert counter.sdo[0x2102][2].raw == 2
    link.turns[1] = -2.25
    assert counter.sdo[0x2102][2].raw == 5  # 0, -1 and -2 turns
    assert counter.sdo[0x2102][1].raw == 0
    assert counter.sdo[0x6010][2].raw == -7


def test_a_sync_brings_two_positions_a_tpdo() -> None:
    link = Link()
    link.slave.on_nmt(NmtCommand.START, 0)
    samples = tuple((channel, 0, channel) for channel in range(4))
    for turns in ((0.0, 0.0, 0.0, 0.0), (1.0, -1.0, 0.5, 0.25)):
        link.device.scan(0, samples, [each * tau for each in turns])
    link.sent.clear()
    for layout in link.slave.on_sync(b"", 0):
        link.slave.pdos.send(layout, 0)
    counts = [int.from_bytes(frame.data[at : at + 4], "little", signed=True) for frame in link.sent for at in (0, 4)]
    assert [frame.can_id for frame in link.sent] == [0x180 + NODE_ID, 0x280 + NODE_ID]
    assert counts == [2000, -2000, 1000, 500]


def test_the_codes_have_a_sign_and_the_width_that_the_cell_sets() -> None:
    kind = KINDS["encoder_counter"]
    narrow = kind.codec(kind.settings(counter_bits=16))  # type: ignore[call-arg]
    assert (narrow.lowest, narrow.full_scale) == (-32_768, 32_767)
    assert kind.codec(kind.settings()).lowest == -(2**31)
