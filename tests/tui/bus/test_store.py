"""What is remembered of a bus: counts, rates, changes, load, nodes, all of it bounded.

Frame lengths for the load are those of ISO 11898-1, as `tests/protocol/test_bits.py` has them from elsewhere.
"""

import pytest

from canarm_protocol.canopen.frames import ERROR_FLAG, Frame
from canarm_protocol.decoding import Book, Decoder
from canarm_protocol.transport.bits import worst_case_bits
from canarm_tui.bus.store import LOG_LENGTH, MOST_ROWS, BusStore
from tests.tui.bus.frames import frame

MS, S = 1_000_000, 1_000_000_000


@pytest.fixture
def store():
    return BusStore(Decoder(Book()), 1_000_000)


def receive(store, texts, time_ns=0, wall_ns=0):
    store.receive([(time_ns, frame(text)) for text in texts], wall_ns)


def test_a_row_counts_and_has_the_rate_and_period_of_the_buss_own_clock(store):
    """400 frames a second of bus time, ten times as fast on the wall clock."""
    for number in range(2001):
        store.receive([(number * 2_500_000, Frame(0x123, b"\x01"))], number * 250_000)
    row = store.now(0).rows[0]
    assert row.times == 2001
    assert row.rate_hz == pytest.approx(400.0, rel=0.01)
    assert row.period_ns == pytest.approx(2_500_000, rel=0.01)


def test_what_falls_silent_has_no_rate_but_keeps_its_period(store):
    for number in range(40):
        receive(store, ["123#00"], number * 100 * MS)
    receive(store, ["124#00"], 9 * S)
    receive(store, ["124#00"], 11 * S)
    silent = store.row((0x123, False, False))
    assert (silent.rate_hz, silent.times) == (0.0, 40)
    assert silent.period_ns == pytest.approx(100 * MS, rel=0.15)


def test_changed_bits_are_those_that_differ_from_the_frame_before(store):
    receive(store, ["123#00FF", "123#01FF"], wall_ns=5)
    row = store.row((0x123, False, False))
    assert (row.changed, row.changed_wall_ns) == (0x0001, 5)
    receive(store, ["123#01FF"], wall_ns=9)
    assert store.row((0x123, False, False)).changed_wall_ns == 5, "equal data change nothing"
    receive(store, ["123#01"], wall_ns=12)
    assert store.row((0x123, False, False)).changed == 0xFF00, "a byte that is gone has changed"


def test_identifiers_of_11_and_29_bits_and_remote_frames_are_rows_of_their_own(store):
    store.receive([(0, frame("123#00")), (0, frame("00000123#00")), (0, Frame(0x123, b"\0", False, True))], 0)
    assert sorted(row.key for row in store.now(0).rows) == [
        (0x123, False, False), (0x123, False, True), (0x123, True, False)
    ]  # fmt: skip


def test_the_load_is_the_bits_with_stuff_bits_over_the_bit_rate(store):
    """Eight bytes of 0x55 have no stuff bits in the data: 47 + 64 bits with the pause, and a few in header and CRC."""
    for number in range(100):
        store.receive([(number * 10 * MS + each, Frame(0x555, b"\x55" * 8)) for each in range(50)], number * 10 * MS)
    load = store.now(99 * 10 * MS).load
    assert load.frames_per_s == pytest.approx(5000.0, rel=0.02)
    assert 5000 * 111 / 1e6 * 0.98 < load.share < 5000 * (worst_case_bits(8) + 3) / 1e6


def test_a_bus_that_is_silent_is_not_busy(store):
    assert store.now(0).load.frames_per_s is None
    for number in range(10):
        receive(store, ["123#00"], number * 100 * MS, number * 100 * MS)
    assert store.now(900 * MS).load.frames_per_s == pytest.approx(10.0)
    assert store.now(10 * S).load.frames_per_s == 0.0


def test_without_a_bit_rate_there_is_no_load():
    store = BusStore(Decoder(Book()), None)
    for number in range(100):
        receive(store, ["123#00"], number * 10 * MS, number * 10 * MS)
    assert store.now(990 * MS).load.share is None
    assert store.now(990 * MS).load.frames_per_s == pytest.approx(100.0, rel=0.02)


def test_memory_is_bounded_whatever_comes(store):
    frames = [(number, Frame(number, bytes(8), True)) for number in range(MOST_ROWS + 5000)]
    store.receive(frames, 0)
    now = store.now(0)
    assert len(now.rows) == MOST_ROWS
    assert len(now.log) == LOG_LENGTH
    assert (now.received, now.untracked) == (MOST_ROWS + 5000, 5000)


def test_frames_that_classical_can_does_not_have_are_counted_and_shown(store):
    store.receive([(0, Frame(0x123, bytes(64))), (0, Frame(ERROR_FLAG | 0x40, bytes(8), True))], 0)
    now = store.now(0)
    assert (now.received, now.errors, len(now.rows)) == (2, 1, 2)


def test_a_clock_that_is_set_back_harms_nothing(store):
    for time_ns in (10 * S, 11 * S, 0, 1 * S, 2 * S, 3 * S):
        receive(store, ["123#00"], time_ns, time_ns)
    row = store.row((0x123, False, False))
    assert row.times == 6
    assert row.rate_hz >= 0.0


def node(store, node_id, wall_ns=0):
    return next(each for each in store.now(wall_ns).nodes if each.node_id == node_id)


def test_a_node_has_state_heartbeat_error_register_and_identity_as_they_were_heard(store):
    receive(store, ["705#00"], wall_ns=0)
    for number in range(1, 20):
        receive(store, ["705#05"], wall_ns=number * 100 * MS)
    receive(store, ["085#3081110000000000", "585#43181001AA010000", "585#4318100234120000"], wall_ns=2 * S)
    found = node(store, 5)
    assert (found.state, found.boots, found.heartbeat_wall_ns) == (5, 1, 1900 * MS)
    assert found.heartbeat_period_ns == pytest.approx(100 * MS)
    assert (found.code, found.register, found.emergencies) == (0x8130, 0x11, 1)
    assert (found.identity, found.is_identity_heard) == ((0x1AA, 0x1234), True)


def test_a_boot_up_forgets_the_errors_before_it(store):
    receive(store, ["085#3081110000000000", "705#00"])
    assert (node(store, 5).code, node(store, 5).register, node(store, 5).boots) == (None, None, 1)


def test_127_nodes_and_no_more(store):
    receive(store, [f"{0x700 + node_id:03X}#05" for node_id in range(128)])
    receive(store, [f"{0x080 + node_id:03X}#0000000000000000" for node_id in range(128)])
    assert [each.node_id for each in store.now(0).nodes] == list(range(1, 128))


@pytest.mark.parametrize("text", ["705#", "705#0505", "085#00", "585#43", "00000705#05"])
def test_malformed_messages_say_nothing_of_a_node(store, text):
    receive(store, [text])
    assert all(each.state is each.register is None for each in store.now(0).nodes)


def test_counting_anew_keeps_the_nodes(store):
    receive(store, ["705#05", "123#00"])
    store.clear()
    now = store.now(0)
    assert (len(now.rows), now.received, len(now.log), len(now.nodes)) == (0, 0, 0, 1)
