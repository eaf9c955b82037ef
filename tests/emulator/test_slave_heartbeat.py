"""Heartbeats, life guarding and emergencies of one node in virtual time, by raw frames, against CiA 301."""

import pytest

from canarm_emulator.timing import NEVER
from canarm_protocol.canopen.frames import Frame, NmtCommand, NmtState
from canarm_protocol.canopen.sdo import SdoAborted, download
from tests.emulator.lone_node import MASTER, MILLISECOND, NO_DATA, NO_OBJECT, NODE_ID, START, STOP, Node, outputs_frame

# Heartbeat (CiA 301, 7.2.8.2.2) and EMCY (7.2.7)


def test_heartbeats_are_produced_exactly_at_their_times_with_the_state(node: Node) -> None:
    node.take()
    node.write(0x1017, 0, 20, 2, now_ns=1_234)
    node.take()
    node.run_until(45 * MILLISECOND)
    node.slave.on_nmt(START, 45 * MILLISECOND)
    node.run_until(65 * MILLISECOND)
    times = [k * 20 * MILLISECOND + 1_234 for k in (1, 2, 3)]
    assert node.take() == list(zip(times, [Frame(0x712, state) for state in (b"\x7f", b"\x7f", b"\x05")], strict=True))
    node.write(0x1017, 0, 0, 2)
    assert node.slave.next_due_ns == NEVER


def watch(node: Node, timeout_ms: int = 100, master: int = MASTER) -> None:
    node.write(0x1016, 1, master << 16 | timeout_ms, 4)
    node.take()


def test_monitoring_begins_with_the_first_heartbeat(node: Node) -> None:
    watch(node)
    assert node.slave.next_due_ns == NEVER
    node.slave.on_heartbeat(2, 0)
    assert node.slave.next_due_ns == NEVER
    node.slave.on_heartbeat(MASTER, 5)
    assert node.slave.watch_due_ns == node.slave.next_due_ns == 100 * MILLISECOND + 5
    node.slave.on_heartbeat(MASTER, 9 * MILLISECOND)
    assert node.slave.watch_due_ns == 109 * MILLISECOND


@pytest.mark.parametrize("entry", [0, MASTER << 16, 0x00_00_0064, 0x81_0064])
def test_an_entry_without_node_or_time_watches_nobody(node: Node, entry: int) -> None:
    node.write(0x1016, 1, entry, 4)
    node.slave.on_heartbeat(MASTER, 0)
    assert node.slave.next_due_ns == NEVER


@pytest.mark.parametrize(
    ("behaviour", "state"), [(0, NmtState.PRE_OPERATIONAL), (1, NmtState.OPERATIONAL), (2, NmtState.STOPPED)]
)
def test_a_lost_heartbeat_acts_exactly_at_its_time(node: Node, behaviour: int, state: NmtState) -> None:
    """EMCY 0x8130, error register generic + communication, 0x1029:1, and CiA 401's error values."""
    watch(node)
    node.write(0x1029, 1, behaviour, 1)
    node.write(0x6444, 2, 0x4000_0000, 4)
    node.write(0x6443, 3, 0, 1)
    node.slave.on_nmt(START, 0)
    node.rpdo(outputs_frame(9, 9, 9, 9))
    node.slave.pdos.apply_outputs()
    node.take()
    node.slave.on_heartbeat(MASTER, 7)
    node.run_until(100 * MILLISECOND + 6)
    assert node.take() == []
    assert node.outputs() == [9, 9, 9, 9]
    node.run_until(200 * MILLISECOND)
    assert node.take() == [(100 * MILLISECOND + 7, Frame(0x92, bytes.fromhex("3081110000000000")))]
    assert node.outputs() == [0, 128, 9, 0]
    assert node.slave.state is state
    if state is not NmtState.STOPPED:
        assert node.read(0x1001) == 0x11
        assert (node.read(0x1003), node.read(0x1003, 1)) == (1, 0x8130)


def test_a_lost_heartbeat_does_not_wake_a_node_that_is_stopped(node: Node) -> None:
    watch(node)
    node.slave.on_heartbeat(MASTER, 0)
    node.slave.on_nmt(STOP, 0)
    node.run_until(MILLISECOND * 1000)
    assert node.slave.state is NmtState.STOPPED


def test_the_return_of_the_heartbeat_is_reported_once_and_monitoring_goes_on(node: Node) -> None:
    watch(node)
    node.slave.on_heartbeat(MASTER, 0)
    node.run_until(200 * MILLISECOND)
    node.take()
    for now_ns in (300 * MILLISECOND, 310 * MILLISECOND):
        node.slave.on_heartbeat(MASTER, now_ns)
    assert node.take() == [(300 * MILLISECOND, Frame(0x92, bytes(8)))]
    assert node.read(0x1001) == 0
    assert node.slave.watch_due_ns == 410 * MILLISECOND


def test_two_errors_end_one_after_the_other(node: Node) -> None:
    watch(node)
    node.write(0x1029, 1, 1, 1)
    node.slave.on_nmt(START, 0)
    node.slave.on_heartbeat(MASTER, 0)
    node.run_until(100 * MILLISECOND)
    node.rpdo(b"", 101 * MILLISECOND)
    node.take()
    node.slave.on_heartbeat(MASTER, 102 * MILLISECOND)
    assert node.take() == [(102 * MILLISECOND, Frame(0x92, bytes.fromhex("0000110000000000")))]
    node.rpdo(bytes(8), 103 * MILLISECOND)
    assert node.take() == [(103 * MILLISECOND, Frame(0x92, bytes(8)))]


def test_the_error_history_has_the_newest_first_keeps_four_and_can_be_cleared(node: Node) -> None:
    """CiA 301, 7.5.2.4."""
    watch(node)
    node.write(0x1029, 1, 1, 1)
    node.slave.on_nmt(START, 0)
    for k in range(5):
        node.slave.on_heartbeat(MASTER, k * 1000 * MILLISECOND)
        node.run_until((k * 1000 + 500) * MILLISECOND)
    node.rpdo(b"", 5000 * MILLISECOND)
    assert [node.read(0x1003, n) for n in range(5)] == [4, 0x8210, 0x8130, 0x8130, 0x8130]
    node.write(0x1003, 0, 0, 1)
    assert node.read(0x1003, 0) == 0
    assert [no_data(node, 0x1003, n) for n in range(1, 5)] == [NO_DATA] * 4


def no_data(node: Node, index: int, subindex: int) -> int:
    with pytest.raises(SdoAborted) as caught:
        node.read(index, subindex)
    return caught.value.code


def test_an_entry_of_the_history_beyond_its_number_has_no_data(node: Node) -> None:
    """CiA 301, 7.5.2.4: only sub-index 1 to the number of errors hold something."""
    watch(node)
    node.slave.on_heartbeat(MASTER, 0)
    node.run_until(500 * MILLISECOND)
    assert (node.read(0x1003, 0), node.read(0x1003, 1)) == (1, 0x8130)
    assert no_data(node, 0x1003, 2) == NO_DATA


def test_switching_the_watch_off_after_a_loss_ends_the_error(node: Node) -> None:
    watch(node)
    node.slave.on_heartbeat(MASTER, 0)
    node.run_until(500 * MILLISECOND)
    assert node.read(0x1001) == 0x11
    node.take()
    node.slave.on_sdo(0x612, next(download(0x1016, 1, bytes(4))), 600 * MILLISECOND)
    assert (600 * MILLISECOND, Frame(0x92, bytes(8))) in node.take()
    assert node.read(0x1001) == 0


def test_a_sync_counter_beyond_its_overflow_is_none(adc: Node) -> None:
    """CiA 301, 7.2.5: the counter runs from 1 to 0x1019. The SYNC acts; its length is right, so no EMCY is sent."""
    adc.write(0x1019, 0, 20, 1)
    adc.write(0x1801, 1, 0x8000_0292, 4)
    adc.write(0x1801, 6, 30, 1)
    adc.write(0x1801, 1, 0x292, 4)
    adc.slave.on_nmt(START, 0)
    adc.take()
    due = [layout.number for layout in adc.slave.on_sync(b"\x1e", 0)]
    assert 2 not in due
    assert due == [layout.number for layout in adc.slave.pdos.tpdos if layout.number != 2]
    assert adc.take() == []


def test_an_entry_of_a_mapping_is_cleared_by_0(adc: Node) -> None:
    """CiA 301, 7.5.2.38."""
    adc.write(0x1801, 1, 0x8000_0292, 4)
    adc.write(0x1A01, 0, 0, 1)
    adc.write(0x1A01, 1, 0, 4)
    assert adc.read(0x1A01, 1) == 0
    assert adc.refused(0x1A01, 0, b"\x01") == NO_OBJECT


def test_a_reset_ends_monitoring_and_clears_errors(node: Node) -> None:
    watch(node)
    node.slave.on_heartbeat(MASTER, 0)
    node.run_until(100 * MILLISECOND)
    node.slave.on_nmt(NmtCommand.RESET_COMMUNICATION, 0)
    node.take()
    assert (node.read(0x1001), node.read(0x1003), node.read(0x1016, 1)) == (0, 0, 0)
    node.slave.on_heartbeat(MASTER, 0)
    assert node.take() == []
    assert node.slave.next_due_ns == NEVER


# Node guarding and life guarding (CiA 301, 7.2.8.3.2.1)


def guard(node: Node, now_ns: int) -> list[bytes]:
    node.take()
    node.slave.on_remote(0x700 + NODE_ID, now_ns)
    return [frame.data for _, frame in node.take() if frame.can_id == 0x700 + NODE_ID]


def test_a_guarding_master_gets_the_state_and_a_toggling_bit(node: Node) -> None:
    assert guard(node, 0) == [b"\x7f"]
    node.slave.on_nmt(START, 1)
    assert guard(node, 2) == [b"\x85"]
    assert guard(node, 3) == [b"\x05"]
    node.slave.on_nmt(STOP, 4)
    assert guard(node, 5) == [b"\x84"]
    node.slave.on_nmt(NmtCommand.RESET_COMMUNICATION, 6)
    assert guard(node, 7) == [b"\x7f"]  # the first answer after boot-up has toggle bit 0


def test_a_node_with_a_heartbeat_is_not_guarded(node: Node) -> None:
    node.write(0x1017, 0, 20, 2)
    assert guard(node, 0) == []


def test_a_master_that_guards_no_longer_is_lost_after_its_life_time(node: Node) -> None:
    node.write(0x100C, 0, 50, 2)
    node.write(0x100D, 0, 3, 1)
    node.slave.on_nmt(START, 0)
    node.rpdo(b"\0\x22" + bytes(6))
    node.slave.on_sync(b"", 0)
    assert node.slave.next_due_ns == NEVER  # monitoring begins with the first question
    guard(node, 1000)
    assert node.slave.next_due_ns == 1000 + 150 * MILLISECOND
    node.run_until(1000 + 150 * MILLISECOND)
    assert node.slave.state is NmtState.PRE_OPERATIONAL
    assert node.outputs() == [0, 0, 0, 0]
    assert [(t, frame.data[:3]) for t, frame in node.take()] == [(1000 + 150 * MILLISECOND, b"\x30\x81\x11")]
    node.slave.on_remote(0x700 + NODE_ID, 200 * MILLISECOND)
    assert [frame.data[:3] for _, frame in node.take()][-1] == b"\0\0\0"


def test_guard_times_of_0_guard_nothing(node: Node) -> None:
    node.write(0x100C, 0, 50, 2)
    guard(node, 0)
    assert node.slave.next_due_ns == NEVER
