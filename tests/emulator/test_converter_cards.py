"""D/A and A/D cards of 8 to 16 bits: registers, CiA 401 objects, EDS files with python-canopen, scans side by side."""

import io
from typing import Any

import canopen
import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm_emulator.bench.bench import Bench
from canarm_emulator.cards.adc import DATA_HIGH, DATA_LOW, END_OF_CONVERSION, STATUS, AdcCard
from canarm_emulator.cards.dac import DacCard
from canarm_emulator.cards.plugged import Plugged, Samples
from canarm_emulator.cards.registers import OPEN_BUS
from canarm_emulator.robot.truth import AdcTruth, Truth
from canarm_protocol.canopen.dictionary import eds_text
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.cards import Codec
from canarm_protocol.cards.analogue import left_adjusted
from canarm_protocol.cell.configuration import card_settings
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.clock import Clock
from tests.resolutions import cell_of_bits, cell_of_two_adcs

FULL_SCALE_V = 5.0
CONVERSION_NS = 20_000
RESOLUTIONS = (8, 10, 12, 15, 16)


@given(st.integers(8, 16).flatmap(lambda bits: st.tuples(st.just(bits), st.integers(0, 2**bits - 1))))
def test_a_code_is_left_adjusted_below_the_sign_and_comes_back_whole(bits_and_code: tuple[int, int]) -> None:
    """CiA 401: the value is left-adjusted, the sign is the highest bit; of 16 bits without sign it takes 32."""
    bits, code = bits_and_code
    codec = left_adjusted(bits)
    assert codec.value(code) == code * 2 ** ((15 if bits <= 15 else 31) - bits)
    assert codec.code(codec.value(code)) == code


def test_a_negative_value_is_least_for_a_code_without_sign_and_itself_for_one_with() -> None:
    assert left_adjusted(12).code(-8) == 0
    assert left_adjusted(12).lowest_value == 0
    assert Codec(16, is_signed=True).code(-5) == -5
    assert (Codec(16, is_signed=True).lowest, Codec(16, is_signed=True).full_scale) == (-32768, 32767)


@pytest.mark.parametrize("bits", RESOLUTIONS)
def test_the_dac_takes_both_bytes_at_once_and_no_bit_beyond_its_resolution(bits: int) -> None:
    outputs: list[tuple[int, float]] = []
    card = DacCard(bits, lambda channel, fraction: outputs.append((channel, fraction)))
    card.write(4, 0xFF, 0)
    assert outputs == []
    card.write(5, 0xFF, 0)
    assert card.code(1) == 2**bits - 1
    assert outputs == [(1, pytest.approx(255 / 256))]
    card.load(2, 2 ** (bits - 1), 0)
    assert outputs[1:] == [(2, pytest.approx(2 ** (bits - 1) / (2**bits - 1) * 255 / 256))]
    assert card.read(4, 0) == OPEN_BUS


@pytest.mark.parametrize("bits", RESOLUTIONS)
def test_the_adc_says_when_it_is_done_and_gives_both_bytes(bits: int) -> None:
    card = AdcCard(bits, lambda channel: channel * 0.5, FULL_SCALE_V, CONVERSION_NS, AdcTruth())
    card.write(7, 0, 1_000)
    assert card.read(STATUS, 1_000 + CONVERSION_NS - 1) == 0
    done_ns = 1_000 + CONVERSION_NS
    assert card.read(STATUS, done_ns) == END_OF_CONVERSION
    assert card.read(DATA_LOW, done_ns) + 256 * card.read(DATA_HIGH, done_ns) == int(3.5 / 5.0 * (2**bits - 1) + 0.5)
    assert card.read(11, done_ns) == OPEN_BUS


def bench_of(cell: Cell) -> Bench:
    silent = {f"{joint}.noise_lsb": "0" for joint in cell.joint_names}
    bench = Bench(cell, Truth.from_settings(cell, silent), Clock.SYNC, seed=0)
    bench.start()
    return bench


class Link(canopen.Network):
    """python-canopen, answered by a bench at once."""

    def __init__(self, bench: Bench) -> None:
        super().__init__()
        self.bench = bench

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        self.bench.receive(Frame(can_id, bytes(data), is_remote=remote), self)
        records, self.bench.records = self.bench.records, []
        for time_ns, frame, origin in records:
            if origin is None:
                self.notify(frame.can_id, bytearray(frame.data), time_ns * 1e-9)

    def card(self, model: str, node_id: int) -> canopen.RemoteNode:
        eds = io.StringIO(eds_text(model))
        eds.name = f"{model}.eds"
        return self.add_node(node_id, eds)


@pytest.mark.parametrize("bits", RESOLUTIONS)
def test_the_stock_client_reads_and_writes_every_width_of_the_values(bits: int) -> None:
    link = Link(bench_of(cell_of_bits(bits)))
    dac, adc = link.card("dac", 0x12), link.card("adc", 0x14)
    dac.sdo["Write analogue output 32-bit"][1].raw = 0x5555_5555
    code = 0x5555_5555 >> 31 - bits
    assert dac.sdo[0x6412][1].raw == code << 31 - bits
    assert dac.sdo[0x6411][1].raw == code << 31 - bits >> 16
    assert dac.sdo[0x6410][1].raw == 0x55
    dac.sdo[0x6411][1].raw = 0x7FFF
    assert dac.sdo[0x6412][1].raw >> 31 - bits == (2**bits - 1 if bits <= 15 else 0xFFFE)
    wide, narrow = adc.sdo["Read analogue input 32-bit"][1].raw, adc.sdo[0x6401][1].raw
    assert wide >> 31 - bits == round((2.5 + 20 * 5 / 270) / 5 * (2**bits - 1))  # konkuk1 is parked at 20 degrees
    assert narrow == wide >> 16


@pytest.mark.parametrize("bits", [12, 16])
def test_what_the_master_sets_is_accepted_and_the_inputs_come_in_that_form(bits: int) -> None:
    """Six inputs of 12 bits take two TPDOs of 16-bit values, of 16 bits three of 32-bit values."""
    cell = cell_of_bits(bits)
    bench = bench_of(cell)
    link = Link(bench)
    nodes = {node.card.node_id: node for node in card_nodes(cell)}
    for node_id, node in nodes.items():
        remote = link.card(node.card.model, node_id)
        for setting in card_settings(node, cell.bus):
            variable = remote.sdo[setting.index]
            (
                variable if isinstance(variable, canopen.sdo.SdoVariable) else variable[setting.subindex]
            ).raw = setting.value
    for node_id in nodes:
        bench.receive(nmt_frame(NmtCommand.START, node_id))
    bench.records.clear()
    bench.receive(sync_frame(1))
    layouts = nodes[0x14].tpdos
    assert [len(layout.objects) for layout in layouts] == ([4, 2] if bits == 12 else [2, 2, 2])
    sent = {record.frame.can_id: record.frame.data for record in bench.records}
    codes = [nodes[0x14].card.codec.code(value) for layout in layouts for value in layout.unpack(sent[layout.cob_id])]
    assert codes[0] == round((2.5 + 20 * 5 / 270) / 5 * (2**bits - 1))
    assert codes[2] == pytest.approx((2**bits - 1) / 2, abs=1)
    assert not {0x294, 0x394} - set(sent)


class WatchedCard:
    """A card whose conversions are noted when they start; else it is `card`."""

    def __init__(self, card: Any, times_ns: list[int]) -> None:
        self._card, self._times_ns = card, times_ns

    def __getattr__(self, name: str) -> Any:
        return getattr(self._card, name)

    def convert(self, begin_ns: int, samples: Samples, volts: list[float]) -> Any:
        self._times_ns.extend(begin_ns + offset_ns for _, offset_ns, _ in samples)
        return self._card.convert(begin_ns, samples, volts)


def watch_starts(plugged: Plugged, times_ns: list[int]) -> None:
    """Note when a card's conversions start."""
    plugged.device._card = WatchedCard(plugged.registers, times_ns)  # type: ignore[attr-defined]


def test_two_adc_cards_convert_at_the_same_time_and_each_sends_when_it_is_done() -> None:
    """Three channels of 100 us beside three of 150 us: samples 0, 100, 200 and 0, 150, 300; done at 300 and 450 us."""
    cell = cell_of_two_adcs(second_us=150)
    bench = bench_of(cell)
    started: dict[int, list[int]] = {0x14: [], 0x15: []}
    for node_id, times_ns in started.items():
        watch_starts(bench.rack.cards[node_id], times_ns)
    for node in card_nodes(cell):
        bench.receive(nmt_frame(NmtCommand.START, node.card.node_id))
    bench.records.clear()
    begin_ns = bench.time_ns
    bench.receive(sync_frame(1))
    assert [time_ns - begin_ns for time_ns in started[0x14]] == [0, 100_000, 200_000]
    assert [time_ns - begin_ns for time_ns in started[0x15]] == [0, 150_000, 300_000]
    stamps = {record.frame.can_id: record.time_ns - begin_ns for record in bench.records if record.frame.can_id > 0x200}
    assert stamps == {0x294: 300_000, 0x394: 300_000, 0x295: 450_000, 0x395: 450_000}


def test_register_accesses_carry_the_time_of_the_message_that_asks_for_them() -> None:
    bench = bench_of(cell_of_bits(12))
    card: Any = bench.rack.cards[0x12].registers
    write, times_ns = card.write, []

    def noted(address: int, value: int, now_ns: int) -> None:
        times_ns.append(now_ns)
        write(address, value, now_ns)

    card.write = noted
    bench.advance(7_300_000)
    Link(bench).card("dac", 0x12).sdo[0x6411][3].raw = 0x1230
    assert times_ns == [7_300_000] * 2  # low byte and high byte
    assert card.code(2) == 0x1230 >> 3
