"""The wire model: arbitration and times against the analysis, errors against ISO 11898-1."""

import itertools
import random
from collections.abc import Iterator

import pytest

from canarm_emulator.timing import NEVER
from canarm_emulator.wire.confinement import ErrorKind, ErrorState
from canarm_emulator.wire.wire import Wire
from canarm_emulator.wire.wire_events import Delivery, ErrorFrame, StateChange
from canarm_emulator.wire.wire_node import Queueing
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.schedulability import Message, response_times
from canarm_protocol.errors import FrameError
from canarm_protocol.transport.bits import arbitration_bits, frame_bits, wire_bits

BIT = 1000
"""ns, at 1 Mbit/s."""
INTERMISSION = 3 * BIT


def wire_of(*nodes: str) -> Wire:
    return Wire(1_000_000, nodes)


def drain(wire: Wire, until_ns: int = 10**9) -> list[Delivery]:
    """Advance from due time to due time, as a driver does."""
    deliveries = []
    while wire.next_due_ns <= until_ns:
        deliveries += wire.advance(wire.next_due_ns)
    return deliveries


def length(frame: Frame) -> int:
    """Time of a frame on the wire, ns."""
    return frame_bits(frame) * BIT


def frame_of_length(bits: int, can_id: int) -> Frame:
    """A frame with this identifier and a length in bits, intermission included."""
    source = random.Random(can_id)
    while True:
        frame = Frame(can_id, bytes(source.choices(b"\x00\xff\x0f\xf0\x3c\xc3", k=8)))
        if frame_bits(frame) + 3 == bits:
            return frame


# Arbitration and times


def test_a_frame_on_an_idle_bus_takes_its_own_length() -> None:
    wire, frame = wire_of("a", "b"), Frame(0x123, b"\x00\xff")
    wire.offer(5_000, frame, "a")
    assert wire.next_due_ns == 5_000 + length(frame)
    assert wire.advance(wire.next_due_ns - 1) == []
    assert wire.advance(wire.next_due_ns) == [Delivery(5_000 + length(frame), frame, "a", 5_000)]
    assert wire.next_due_ns == NEVER


def test_the_lowest_identifier_of_those_that_wait_goes_first() -> None:
    wire = wire_of("a", "b", "c")
    frames = {"a": Frame(0x300), "b": Frame(0x100), "c": Frame(0x200)}
    for sender, frame in frames.items():
        wire.offer(0, frame, sender)
    assert [each.frame.can_id for each in drain(wire)] == [0x100, 0x200, 0x300]
    assert [wire.nodes[name].lost_arbitrations for name in "abc"] == [2, 0, 1]


def test_a_frame_that_comes_while_another_is_sent_waits_for_its_end_and_three_bits() -> None:
    wire, slow, urgent = wire_of("a", "b"), Frame(0x700, bytes(8)), Frame(0x001)
    wire.offer(0, slow, "a")
    wire.offer(1, urgent, "b")
    first, second = drain(wire)
    assert (first.frame, second.frame) == (slow, urgent)
    assert second.start_ns == length(slow) + INTERMISSION


def test_a_frame_offered_at_the_time_the_wire_has_reached_still_competes() -> None:
    wire = wire_of("a", "b")
    wire.offer(0, Frame(0x700), "a")
    wire.advance(0)
    wire.offer(0, Frame(0x001), "b")
    assert [each.frame.can_id for each in drain(wire)] == [0x001, 0x700]


def test_a_time_gone_by_and_a_stranger_are_refused() -> None:
    wire = wire_of("a", "b")
    wire.advance(10)
    with pytest.raises(ValueError, match="offered at 9 ns; the wire is at 10 ns already"):
        wire.offer(9, Frame(1), "a")
    with pytest.raises(ValueError, match="node 'c' is not on the bus; attached: 'a', 'b'"):
        wire.offer(10, Frame(1), "c")
    with pytest.raises(FrameError, match="does not fit 11 bits"):
        wire.offer(10, Frame(0x800), "a")
    with pytest.raises(ValueError, match="whole number of ns"):
        Wire(83_333)


def test_a_controller_sends_first_in_first_out_unless_told_otherwise() -> None:
    wire = Wire(1_000_000, ["b"])
    wire.attach("fifo")
    for can_id in (0x300, 0x100, 0x200):
        wire.offer(0, Frame(can_id), "fifo")
    assert [each.frame.can_id for each in drain(wire)] == [0x300, 0x100, 0x200]
    wire.attach("priority", Queueing.PRIORITY)
    for can_id in (0x300, 0x100, 0x200):
        wire.offer(wire.time_ns, Frame(can_id), "priority")
    assert [each.frame.can_id for each in drain(wire)] == [0x100, 0x200, 0x300]


def test_frames_offered_ahead_are_sent_in_the_order_of_their_times() -> None:
    wire = wire_of("a", "b")
    wire.offer(2_000_000, Frame(0x100), "a")
    wire.offer(1_000_000, Frame(0x200), "a")
    assert [each.start_ns for each in drain(wire)] == [1_000_000, 2_000_000]


@pytest.mark.parametrize("step_ns", [7_000, 130_000, 10**9])
def test_how_often_the_wire_is_advanced_changes_nothing(step_ns: int) -> None:
    def run(times: Iterator[int]) -> list[Delivery]:
        source, wire = random.Random(8), wire_of("a", "b", "c")
        for _ in range(60):
            frame = Frame(source.getrandbits(11), source.randbytes(source.randrange(9)))
            wire.offer(source.randrange(8_000_000), frame, source.choice("abc"))
        wire.corrupt(source.choice([node.queue[0].frame.can_id for node in wire.nodes.values()]))
        return [each for until_ns in times for each in wire.advance(until_ns)]

    assert run(iter(range(0, 20_000_000 + step_ns, step_ns))) == run(iter([20_000_000]))


def test_load_counts_frames_with_their_intermission() -> None:
    """Two frames back to back in a millisecond, then a millisecond of silence."""
    wire, frame = wire_of("a", "b"), Frame(0x123, bytes(8))
    wire.offer(0, frame, "a")
    wire.offer(0, frame, "a")
    busy_ns = 2 * (length(frame) + INTERMISSION)
    wire.advance(length(frame) // 2)
    assert wire.load() == 1.0
    wire.advance(length(frame))
    assert wire.load() == wire.load(length(frame)) == 1.0, "intermission lies ahead"
    wire.advance(1_000_000)
    assert wire.load() == wire.load(1_000_000) == pytest.approx(busy_ns / 1e6)
    wire.advance(2_000_000)
    assert wire.load() == pytest.approx(busy_ns / 2e6)
    assert wire.load(1_000_000) == 0.0
    assert wire.load(2_000_000 - busy_ns // 2) == pytest.approx(busy_ns / 2 / (2e6 - busy_ns / 2))
    with pytest.raises(ValueError, match="remembers"):
        wire.load(2 * 10**9)


# Against the response time analysis


def test_the_published_example_reaches_its_worst_response_and_never_exceeds_it() -> None:
    """Davis et al. 2007: A, B, C of 125 bits at 125 kbit/s, 2, 3 and 3.5 ms; C when all are released together."""
    bit_ns, period_ns = 8_000, {"A": 2_500_000, "B": 3_500_000, "C": 3_500_000}
    frames = {name: frame_of_length(125, can_id) for can_id, name in enumerate("ABC", start=1)}
    worst_ns = {"A": 2_000_000, "B": 3_000_000, "C": 3_500_000}
    found = dict.fromkeys("ABC", 0)
    for early in (None, "B", "C"):
        wire = Wire(125_000, "ABC")
        for name in "ABC":
            offset_ns = 0 if early in (None, name) else 1
            for time_ns in range(offset_ns, 70_000_000, period_ns[name]):
                wire.offer(time_ns, frames[name], name)
        wire.advance(100_000_000)
        for name in "ABC":
            response_ns = wire.worst_response_ns[(frames[name].can_id, False)] + 3 * bit_ns
            assert response_ns <= worst_ns[name]
            found[name] = max(found[name], response_ns)
    assert found["C"] == worst_ns["C"]
    assert found["A"] >= worst_ns["A"] - 1
    assert found["B"] >= worst_ns["B"] - 1


@pytest.mark.parametrize("seed", range(8))
def test_no_response_of_random_traffic_exceeds_the_analysis(seed: int) -> None:
    source = random.Random(seed)
    frames = [Frame(can_id, source.randbytes(source.randrange(9))) for can_id in source.sample(range(2048), 8)]
    periods_ns = [source.randrange(1_000_000, 5_000_000) for _ in frames]
    wire = Wire(500_000)
    for place in range(4):
        wire.attach(place, Queueing.PRIORITY)
    for place, (frame, period_ns) in enumerate(zip(frames, periods_ns, strict=True)):
        for time_ns in range(source.randrange(period_ns), 100_000_000, period_ns):
            wire.offer(time_ns, frame, place % 4)
    wire.advance(200_000_000)
    messages = [
        Message("", frame.can_id, frame_bits(frame) + 3, period_ns)
        for frame, period_ns in zip(frames, periods_ns, strict=True)
    ]
    for response in response_times(messages, 500_000):
        assert response.worst_ns is not None
        assert wire.worst_response_ns[(response.message.can_id, False)] + 3 * 2_000 <= response.worst_ns


# Errors


def test_a_crc_error_everywhere_is_signalled_and_the_frame_sent_again() -> None:
    """Nobody acknowledges: the transmitter flags from the ACK delimiter, the receivers a bit later: 7 + 8 + 3 bits."""
    wire, frame = wire_of("a", "b", "c"), Frame(0x100, b"\x55" * 8)
    wire.corrupt(0x100)
    wire.offer(0, frame, "a")
    error_end_ns = length(frame) - 8 * BIT + (7 + 8) * BIT
    assert wire.next_due_ns == error_end_ns
    assert wire.advance(error_end_ns) == []
    assert wire.events == [ErrorFrame(error_end_ns, ErrorKind.CRC, frame, "a")]
    assert (wire.nodes["a"].tec, wire.nodes["b"].rec, wire.nodes["c"].rec) == (8, 1, 1)
    (delivery,) = drain(wire)
    assert delivery.start_ns == error_end_ns + INTERMISSION
    assert (wire.nodes["a"].tec, wire.nodes["b"].rec, wire.nodes["c"].rec) == (7, 0, 0)
    assert wire.worst_response_ns[(0x100, False)] == delivery.end_ns


def test_a_receiver_that_alone_sees_an_error_pays_more_than_the_others() -> None:
    """Rule b: the first bit after its flag is dominant, for the others flag one bit later: 1 + 8."""
    wire, frame = wire_of("a", "b", "c"), Frame(0x100, b"\x55" * 8)
    wire.corrupt(0x100, receivers=["c"])
    wire.offer(0, frame, "a")
    wire.advance(wire.next_due_ns)
    assert wire.time_ns == length(frame) - 7 * BIT + (7 + 8) * BIT
    assert (wire.nodes["a"].tec, wire.nodes["b"].rec, wire.nodes["c"].rec) == (8, 1, 9)
    drain(wire)
    assert (wire.nodes["a"].tec, wire.nodes["b"].rec, wire.nodes["c"].rec) == (7, 0, 8)


def test_the_nth_transmission_of_an_identifier_is_hit_and_no_other() -> None:
    wire = wire_of("a", "b")
    wire.corrupt(0x100, nth=3)
    for can_id in (0x100, 0x200, 0x100, 0x200, 0x100, 0x100):
        wire.offer(wire.time_ns, Frame(can_id), "a")
    drain(wire)
    assert [event.frame.can_id for event in wire.events if isinstance(event, ErrorFrame)] == [0x100]
    assert wire.nodes["a"].sent == 6
    assert wire.nodes["a"].errors == 1


@pytest.mark.parametrize("bit", [0, 5, 17, 40, 1000])
def test_a_bit_error_stops_the_frame_at_once(bit: int) -> None:
    """Flags of 6 to 12 bits from the bit after the error, then the delimiter."""
    wire, frame = wire_of("a", "b"), Frame(0x2A5, b"\x5a\x81\x3c\xff")
    wire.corrupt(0x2A5, bit=bit)
    wire.offer(0, frame, "a")
    wire.advance(wire.next_due_ns)
    seen = min(arbitration_bits(frame) + bit, frame_bits(frame) - 11) + 1
    assert 6 + 8 <= wire.time_ns // BIT - seen <= 12 + 8
    assert (wire.nodes["a"].tec, wire.nodes["b"].rec) == (8, 1)
    assert isinstance(wire.events[0], ErrorFrame)
    assert wire.events[0].kind is ErrorKind.BIT
    assert [each.frame for each in drain(wire)] == [frame]


def test_a_lone_node_becomes_error_passive_and_never_bus_off() -> None:
    """TEC rises by 8 to 128 and stays: an error-passive node's ACK errors do not count (rule c, exception 1)."""
    wire, frame = wire_of("a"), Frame(0x100)
    wire.offer(0, frame, "a")
    counters, starts = [], [0]
    for _ in range(40):
        wire.advance(wire.next_due_ns)
        counters.append(wire.nodes["a"].tec)
        starts.append(wire.time_ns)
    assert counters == [*range(8, 129, 8)] + [128] * 24
    gaps = [after - before for before, after in itertools.pairwise(starts)]
    attempt = length(frame) - 8 * BIT + (6 + 8) * BIT
    assert gaps[0] == attempt
    assert set(gaps[1:16]) == {attempt + INTERMISSION}
    assert set(gaps[16:]) == {attempt + INTERMISSION + 8 * BIT}
    assert [event for event in wire.events if isinstance(event, StateChange)] == [
        StateChange(starts[16], "a", ErrorState.PASSIVE)
    ]
    wire.attach("b")
    drain(wire, wire.time_ns + 1_000_000)
    assert (wire.nodes["a"].tec, wire.nodes["a"].state, wire.nodes["a"].sent) == (127, ErrorState.ACTIVE, 1)


def bus_off_wire() -> Wire:
    wire = wire_of("a", "b", "c")
    wire.corrupt(0x100, times=32)
    wire.offer(0, Frame(0x100), "a")
    drain(wire)
    return wire


def test_thirty_two_errors_in_a_row_end_in_bus_off() -> None:
    """16 x 8 = 128: error-passive; 32 x 8 = 256: bus-off. Receivers count 1 each."""
    wire = bus_off_wire()
    node = wire.nodes["a"]
    assert (node.tec, node.state, node.errors, node.sent) == (256, ErrorState.BUS_OFF, 32, 0)
    assert [event.state for event in wire.events if isinstance(event, StateChange)] == [
        ErrorState.PASSIVE,
        ErrorState.BUS_OFF,
    ]
    assert wire.nodes["b"].rec == 32
    assert node.discarded == 1
    assert not wire.offer(wire.time_ns, Frame(0x100), "a")
    assert node.discarded == 2


def test_a_node_in_bus_off_does_not_acknowledge() -> None:
    wire = bus_off_wire()
    wire.detach("c")
    wire.offer(wire.time_ns, Frame(0x200), "b")
    wire.advance(wire.next_due_ns)
    assert wire.nodes["b"].tec == 8


def test_recovery_on_an_idle_bus_takes_1408_bits() -> None:
    wire = bus_off_wire()
    wire.advance(wire.time_ns + 10_000_000)
    assert wire.nodes["a"].state is ErrorState.BUS_OFF
    asked_ns = wire.time_ns
    wire.recover("a")
    assert wire.next_due_ns == asked_ns + 1408 * BIT
    wire.advance(wire.next_due_ns - 1)
    assert wire.nodes["a"].state is ErrorState.BUS_OFF
    wire.advance(asked_ns + 1408 * BIT)
    assert (wire.nodes["a"].tec, wire.nodes["a"].state) == (0, ErrorState.ACTIVE)
    assert wire.events[-1] == StateChange(asked_ns + 1408 * BIT, "a", ErrorState.ACTIVE)
    assert wire.offer(wire.time_ns, Frame(0x100), "a")
    assert len(drain(wire)) == 1


def test_recovery_on_a_full_bus_takes_128_frames() -> None:
    """ACK delimiter, end of frame and intermission are 11 recessive bits; nothing longer is seen on a full bus."""
    wire = bus_off_wire()
    frame = Frame(0x200, b"\x55" * 8)
    start_ns = wire.time_ns + 100_000
    wire.advance(start_ns)
    for _ in range(200):
        wire.offer(start_ns, frame, "b")
    wire.recover("a")
    drain(wire)
    (back,) = (event for event in wire.events if event == StateChange(event[0], "a", ErrorState.ACTIVE))
    assert back.time_ns == start_ns + 128 * (length(frame) + INTERMISSION)


def test_an_error_passive_transmitter_lets_others_go_first() -> None:
    """Suspend transmission: 8 bits after intermission, in which a frame of less urgency may start."""
    wire = wire_of("a", "b", "c")
    wire.corrupt(0x100, times=16)
    wire.offer(0, Frame(0x100), "a")
    while wire.nodes["a"].state is not ErrorState.PASSIVE:
        wire.advance(wire.next_due_ns)
    wire.offer(wire.time_ns, Frame(0x700), "b")
    wire.offer(wire.time_ns, Frame(0x001), "a")
    assert [each.frame.can_id for each in drain(wire)] == [0x700, 0x100, 0x001]


def test_an_error_passive_receiver_cannot_destroy_a_frame_and_misses_it() -> None:
    wire = wire_of("a", "b", "c")
    wire.corrupt(0x100, times=20, receivers=["c"])
    wire.offer(0, Frame(0x100), "a")
    (delivery,) = drain(wire)
    assert delivery.missed_by == {"c"}
    assert wire.nodes["c"].state is ErrorState.PASSIVE
    assert wire.nodes["a"].errors == 15, "15 x 9 = 135 > 127"
    assert wire.nodes["c"].rec == 136


def test_a_success_takes_an_error_passive_receiver_back_below_the_limit() -> None:
    """Rule h: a REC above 127 becomes a value from 119 to 127."""
    wire = wire_of("a", "b", "c")
    wire.corrupt(0x100, times=16, receivers=["c"])
    for _ in range(2):
        wire.offer(wire.time_ns, Frame(0x100), "a")
    drain(wire)
    assert 118 <= wire.nodes["c"].rec <= 127
    assert wire.nodes["c"].state is ErrorState.ACTIVE


def test_two_nodes_with_one_identifier_destroy_each_other_until_both_are_passive() -> None:
    """K.-T. Cho, K. G. Shin, "Error handling of in-vehicle networks makes them vulnerable", CCS 2016, section 4.

    16 collisions take both to 128; then the one that sends recessive fails alone, and the other's frame gets through.
    """
    wire = wire_of("a", "b", "c")
    dominant, recessive = Frame(0x100, b"\x00"), Frame(0x100, b"\xff")
    wire.offer(0, recessive, "a")
    wire.offer(0, dominant, "b")
    deliveries = drain(wire)
    errors = [event for event in wire.events if isinstance(event, ErrorFrame)]
    assert len(errors) == 16
    assert [each.frame for each in deliveries] == [dominant, recessive]
    assert wire.nodes["b"].tec == 127
    assert wire.nodes["a"].tec == 128 + 8 - 1


def test_two_nodes_that_send_the_same_frame_together_do_not_notice() -> None:
    wire, frame = wire_of("a", "b", "c"), Frame(0x100, b"\x01")
    wire.offer(0, frame, "a")
    wire.offer(0, frame, "b")
    assert [each.frame for each in drain(wire)] == [frame]
    assert (wire.nodes["a"].sent, wire.nodes["b"].sent) == (1, 1)


def test_a_node_that_leaves_takes_its_frames_along() -> None:
    wire = wire_of("a", "b", "c")
    wire.offer(0, Frame(0x100), "a")
    wire.offer(0, Frame(0x200), "b")
    wire.detach("a")
    assert [each.frame.can_id for each in drain(wire)] == [0x200]
    with pytest.raises(ValueError, match="on the bus already"):
        wire.attach("b")


def test_wire_bits_of_the_collision_differ_where_the_error_falls() -> None:
    wire = wire_of("a", "b", "c")
    one, other = Frame(0x100, b"\x00"), Frame(0x100, b"\xff")
    wire.offer(0, one, "a")
    wire.offer(0, other, "b")
    wire.advance(wire.next_due_ns)
    pairs = zip(wire_bits(one), wire_bits(other), strict=False)
    differing = next(index for index, (a, b) in enumerate(pairs) if a != b)
    assert differing + 1 + 6 + 8 <= wire.time_ns // BIT <= differing + 1 + 12 + 8


def test_the_load_of_the_busiest_second_is_kept() -> None:
    """Half of a second within a quiet minute."""
    wire = Wire(1_000_000, ["a", "b"])
    frame = Frame(0x123, bytes(8))
    busy_ns = (frame_bits(frame) + 3) * 1000  # 3 bits of intermission (ISO 11898-1)
    count = 500_000_000 // busy_ns
    start_ns = 30_000_000_000
    wire.advance(start_ns)
    for number in range(count):
        wire.offer(start_ns + 2 * number * busy_ns, frame, "a")
        wire.advance(start_ns + 2 * (number + 1) * busy_ns)
    wire.advance(60_000_000_000)
    assert wire.peak_load == pytest.approx(count * busy_ns / 1e9)
    assert wire.load(1_000_000_000) == 0.0
    assert wire.load() == pytest.approx(count * busy_ns / 60e9)


def test_before_a_second_is_over_the_busiest_is_all_there_was() -> None:
    wire = Wire(1_000_000, ["a", "b"])
    wire.offer(0, Frame(0x123, bytes(8)), "a")
    wire.advance(1_000_000)
    assert wire.peak_load == wire.load() > 0.1
