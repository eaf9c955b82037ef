"""Response times against Davis, Burns, Bril, Lukkien 2007, and the verdict on the shipped cell."""

import dataclasses
import re

import pytest

from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.schedulability import (
    Message,
    bus_load,
    cell_messages,
    cell_verdict,
    message_bits,
    response_times,
)
from canarm_protocol.cell.wiring import CardNode, card_nodes

MS = 1_000_000
EXAMPLE = (
    Message("A", 1, 125, 2_500_000, deadline_ns=2_500_000),
    Message("B", 2, 125, 3_500_000, deadline_ns=3_250_000),
    Message("C", 3, 125, 3_500_000, deadline_ns=3_250_000),
)
"""Davis et al. 2007, section 3.3: 125 bits at 125 kbit/s take 1 ms."""


@pytest.fixture(scope="module")
def konkuk1() -> Cell:
    return load_cell("konkuk1")


@pytest.fixture(scope="module")
def nodes(konkuk1: Cell) -> tuple[CardNode, ...]:
    return card_nodes(konkuk1)


def at(cell: Cell, **changes: int) -> Cell:
    return cell.model_copy(update={"bus": cell.bus.model_copy(update=changes)})


def test_the_example_in_which_the_first_analysis_fails_has_the_published_response_times() -> None:
    """2, 3 and 3.5 ms; the first analysis gave C 3 ms, because it looked at one instance only."""
    responses = response_times(EXAMPLE, 125_000)
    assert [response.worst_ns for response in responses] == [2 * MS, 3 * MS, 3_500_000]
    assert [response.is_in_time for response in responses] == [True, True, False]


def test_the_example_loads_the_bus_as_published() -> None:
    """1/2.5 + 1/3.5 + 1/3.5: 97 %."""
    assert bus_load(EXAMPLE, 125_000) == pytest.approx(0.9714, abs=5e-5)


def test_order_of_the_messages_does_not_matter() -> None:
    assert response_times(EXAMPLE[::-1], 125_000) == response_times(EXAMPLE, 125_000)


def test_queuing_jitter_of_the_most_urgent_delays_the_others() -> None:
    """Jitter of 0.6 ms brings a second A into B's wait: 3 ms become 4; A itself is later by its jitter."""
    jittery = (dataclasses.replace(EXAMPLE[0], jitter_ns=600_000), EXAMPLE[1])
    calm = (EXAMPLE[0], EXAMPLE[1])
    assert [response.worst_ns for response in response_times(calm, 125_000)] == [2 * MS, 2 * MS]
    assert [response.worst_ns for response in response_times(jittery, 125_000)] == [2_600_000, 2 * MS]
    third = Message("C", 3, 125, 10 * MS)
    assert response_times((*calm, third), 125_000)[1].worst_ns == 3 * MS
    assert response_times((*jittery, third), 125_000)[1].worst_ns == 4 * MS


def test_more_than_the_bus_can_carry_has_no_bound() -> None:
    messages = (*EXAMPLE, Message("D", 4, 125, 10 * MS))
    assert [response.worst_ns for response in response_times(messages, 125_000)][3] is None
    assert response_times(messages, 125_000)[0].worst_ns == 2 * MS


def test_a_full_message_takes_135_bits_and_an_extended_one_160() -> None:
    assert message_bits(8) == 135
    assert message_bits(8, is_extended=True) == 160


def test_konkuk1_sends_455_bits_a_cycle(konkuk1: Cell, nodes: tuple[CardNode, ...]) -> None:
    """With 55 + 10 s bits: SYNC 65, latch 65, two TPDOs of 8 and 4 bytes 135 + 95, DAC 95."""
    cycle = [message for message in cell_messages(konkuk1, nodes) if message.period_ns == 2_500_000]
    assert [(message.can_id, message.bits) for message in cycle] == [
        (0x080, 65),
        (0x213, 65),
        (0x294, 135),
        (0x312, 95),
        (0x394, 95),
    ]
    assert sum(message.bits for message in cycle) == 455


def test_heartbeats_of_controller_and_cards_come_every_20_ms(konkuk1: Cell, nodes: tuple[CardNode, ...]) -> None:
    slow = [message for message in cell_messages(konkuk1, nodes) if message.period_ns == 20 * MS]
    assert [message.can_id for message in slow] == [0x701, 0x712, 0x713, 0x714]


def test_time_is_counted_on_request(konkuk1: Cell, nodes: tuple[CardNode, ...]) -> None:
    """TIME has six bytes: 115 bits more in 2500."""
    plain, with_time = cell_messages(konkuk1, nodes), cell_messages(konkuk1, nodes, with_time=True)
    assert bus_load(with_time, 1_000_000) - bus_load(plain, 1_000_000) == pytest.approx(115 / 2500)


def test_konkuk1_fits_at_1_mbit(konkuk1: Cell, nodes: tuple[CardNode, ...]) -> None:
    """455 bits in 2500 and 4 x 65 in 20000: 19.5 %. Chain: 130 + 600 + 295 + 500 + 225 = 1750 us."""
    verdict = cell_verdict(konkuk1, nodes)
    assert verdict.fits
    assert verdict.load == pytest.approx(455 / 2500 + 260 / 20000)
    assert any("= 455 bits" in line for line in verdict.lines)
    assert any("= 1750 us of 2500 us" in line for line in verdict.lines)
    assert verdict.lines[-1] == "fits: 750 us of 2500 us are left"
    assert "SYNC 0x080: at most 200 us, limit 2500 us" in verdict.lines


def test_the_terms_of_the_chain_add_up_for_a_reader(konkuk1: Cell, nodes: tuple[CardNode, ...]) -> None:
    (chain,) = [line for line in cell_verdict(konkuk1, nodes).lines if line.startswith("chain")]
    terms, _, total = chain.removeprefix("chain of a cycle: ").partition(" = ")
    numbers = re.findall(r"(?<= )(?:(\d+) x )?(\d+)(?= [+(])", f"{terms} +")
    assert sum(int(times or 1) * int(number) for times, number in numbers) == int(total.split()[0]) == 1750
    assert "SYNC 65 +" in chain


def test_konkuk1_does_not_fit_at_125_kbit(konkuk1: Cell, nodes: tuple[CardNode, ...]) -> None:
    """455 bits take 3640 us of 2500: 145.6 %, and 10.4 % of heartbeats."""
    verdict = cell_verdict(at(konkuk1, bitrate=125_000), nodes)
    assert not verdict.fits
    assert verdict.load == pytest.approx(1.56)
    assert "125000 bit/s x 2500 us = 312 bits per cycle" in verdict.lines[0]
    assert any(line.startswith("RPDO2 of dac 0x312: without a bound, limit 2500 us: TOO") for line in verdict.lines)
    assert verdict.lines[-1].startswith("does not fit: raise bus.bitrate")


def test_a_load_below_100_percent_is_refused_when_the_chain_outlasts_the_cycle(
    konkuk1: Cell, nodes: tuple[CardNode, ...]
) -> None:
    """At 250 kbit/s 650 bits take 2600 us; with 1100 us of scan and computing 3700 of 2500."""
    verdict = cell_verdict(at(konkuk1, bitrate=250_000), nodes)
    assert verdict.load < 0.8
    assert not verdict.fits
    assert any("= 3700 us of 2500 us: TOO LONG" in line for line in verdict.lines)


def test_a_longer_cycle_makes_room(konkuk1: Cell, nodes: tuple[CardNode, ...]) -> None:
    assert cell_verdict(at(konkuk1, bitrate=250_000, cycle_us=4000), nodes).fits
