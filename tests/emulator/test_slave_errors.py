"""Errors of one node that come and go, alone and together, in virtual time and by raw frames, against CiA 301."""

import pytest

from canarm_emulator.timing import NEVER
from canarm_emulator.wire.confinement import ErrorState
from canarm_protocol.canopen.frames import Frame, NmtCommand, NmtState
from canarm_protocol.canopen.sdo import download
from tests.emulator.lone_node import MASTER, MILLISECOND, NODE_ID, START, STOP, Node, outputs_frame

SECOND_MASTER = 0x2A
INCOMPATIBLE = 0x0604_0043


def watch_two(node: Node) -> None:
    node.write(0x1016, 1, MASTER << 16 | 100, 4)
    node.write(0x1016, 3, SECOND_MASTER << 16 | 30, 4)
    node.take()


def test_every_entry_of_the_heartbeat_consumer_watches_its_node(node: Node) -> None:
    """CiA 301, 7.5.2.19: an entry per node, each with its own time."""
    watch_two(node)
    assert node.read(0x1016) == 4
    assert set(node.slave.watched_node_ids) == {MASTER, SECOND_MASTER}
    node.slave.on_heartbeat(MASTER, 0)
    node.slave.on_heartbeat(SECOND_MASTER, 0)
    node.run_until(29 * MILLISECOND)
    assert node.take() == []
    node.run_until(99 * MILLISECOND)
    assert node.take() == [(30 * MILLISECOND, Frame(0x92, bytes.fromhex("3081110000000000")))]
    assert node.slave.watch_due_ns == 100 * MILLISECOND


@pytest.mark.parametrize("lost", [MASTER, SECOND_MASTER])
def test_the_loss_of_any_watched_node_gives_the_outputs_their_error_values(node: Node, lost: int) -> None:
    watch_two(node)
    node.write(0x1029, 1, 1, 1)
    node.slave.on_nmt(START, 0)
    node.rpdo(outputs_frame(9, 9, 9, 9))
    node.slave.pdos.apply_outputs()
    node.slave.on_heartbeat(lost, 0)
    node.run_until(1000 * MILLISECOND)
    assert node.outputs() == [0, 0, 0, 0]


def test_the_error_is_over_when_the_last_lost_node_is_back(node: Node) -> None:
    watch_two(node)
    for node_id in (MASTER, SECOND_MASTER):
        node.slave.on_heartbeat(node_id, 0)
    node.run_until(100 * MILLISECOND)
    node.take()
    node.slave.on_heartbeat(MASTER, 101 * MILLISECOND)
    assert node.take() == []
    assert node.read(0x1001) == 0x11
    node.slave.on_heartbeat(SECOND_MASTER, 102 * MILLISECOND)
    assert node.take() == [(102 * MILLISECOND, Frame(0x92, bytes(8)))]


def test_a_second_entry_for_the_same_node_is_refused(node: Node) -> None:
    """CiA 301, 7.5.2.19: abort 0604 0043h where both times are not 0; one entry may be written again."""
    watch_two(node)
    assert node.refused(0x1016, 2, (MASTER << 16 | 50).to_bytes(4, "little")) == INCOMPATIBLE
    assert node.read(0x1016, 2) == 0
    node.write(0x1016, 2, MASTER << 16, 4)
    node.write(0x1016, 1, MASTER << 16 | 50, 4)
    node.write(0x1016, 1, 0, 4)
    node.write(0x1016, 2, MASTER << 16 | 50, 4)
    assert set(node.slave.watched_node_ids) == {MASTER, SECOND_MASTER}


def test_writing_one_entry_leaves_the_others_monitoring(node: Node) -> None:
    watch_two(node)
    for node_id in (MASTER, SECOND_MASTER):
        node.slave.on_heartbeat(node_id, 0)
    node.write(0x1016, 3, 0, 4)
    assert node.slave.watch_due_ns == 100 * MILLISECOND
    node.write(0x1016, 1, 0, 4)
    assert node.slave.watch_due_ns == NEVER


@pytest.mark.parametrize("behaviour", [0, 1])
def test_error_passive_is_reported_once_and_changes_nothing_else(node: Node, behaviour: int) -> None:
    node.write(0x1029, 1, behaviour, 1)
    node.slave.on_nmt(START, 0)
    node.rpdo(outputs_frame(9, 9, 9, 9))
    node.slave.pdos.apply_outputs()
    node.take()
    node.slave.on_error_state(ErrorState.PASSIVE, 5)
    node.slave.on_error_state(ErrorState.ACTIVE, 8)
    assert node.take() == [(5, Frame(0x92, bytes.fromhex("2081110000000000"))), (8, Frame(0x92, bytes(8)))]
    assert node.outputs() == [9, 9, 9, 9]
    assert node.slave.state is NmtState.OPERATIONAL
    assert (node.read(0x1001), node.read(0x1003, 1)) == (0, 0x8120)


def emergencies(node: Node) -> list[tuple[int, int]]:
    """Error code and register of every EMCY since the last look."""
    frames = [frame for _, frame in node.take() if frame.can_id == 0x80 + NODE_ID]
    return [(int.from_bytes(frame.data[:2], "little"), frame.data[2]) for frame in frames]


def miss_a_deadline(node: Node) -> None:
    node.write(0x1401, 5, 5, 2)
    node.slave.on_nmt(START, 0)
    node.rpdo(bytes(8), 0)
    node.slave.run_timers(5 * MILLISECOND)
    assert emergencies(node) == [(0x8250, 0x11)]


@pytest.mark.parametrize(("subindex", "value", "size"), [(5, 0, 2), (1, 0x8000_0312, 4)])
def test_a_missed_rpdo_is_no_error_any_more_once_nobody_waits_for_it(
    node: Node, subindex: int, value: int, size: int
) -> None:
    miss_a_deadline(node)
    node.slave.on_nmt(NmtCommand.PRE_OPERATIONAL, 6 * MILLISECOND)
    assert node.read(0x1001) == 0x11
    request = next(download(0x1401, subindex, value.to_bytes(size, "little")))
    node.slave.on_sdo(0x600 + NODE_ID, request, 7 * MILLISECOND)
    assert emergencies(node) == [(0, 0)]
    assert node.read(0x1001) == 0


def test_a_missed_rpdo_stays_an_error_while_it_is_waited_for(node: Node) -> None:
    miss_a_deadline(node)
    node.slave.on_nmt(NmtCommand.PRE_OPERATIONAL, 6 * MILLISECOND)
    node.write(0x1401, 5, 50, 2)
    node.slave.on_nmt(START, 7 * MILLISECOND)
    assert node.read(0x1001) == 0x11
    node.rpdo(bytes(8), 8 * MILLISECOND)
    assert emergencies(node) == [(0, 0)]


def test_an_rpdo_that_was_too_short_is_no_error_any_more_once_it_is_disabled(node: Node) -> None:
    node.slave.on_nmt(START, 0)
    node.rpdo(bytes(3))
    assert emergencies(node) == [(0x8210, 0x11)]
    node.slave.on_nmt(NmtCommand.PRE_OPERATIONAL, 0)
    node.slave.on_sdo(0x600 + NODE_ID, next(download(0x1401, 1, (0x8000_0312).to_bytes(4, "little"))), 0)
    assert emergencies(node) == [(0, 0)]


@pytest.mark.parametrize("command", [START, NmtCommand.PRE_OPERATIONAL])
def test_an_error_that_ended_in_stopped_is_told_when_stopped_ends(node: Node, command: NmtCommand) -> None:
    """CiA 301, 7.3.2.2.4: what comes up in STOPPED is pending."""
    node.write(0x1029, 1, 2, 1)
    node.write(0x1016, 1, MASTER << 16 | 100, 4)
    node.slave.on_nmt(START, 0)
    node.slave.on_heartbeat(MASTER, 0)
    node.slave.run_timers(100 * MILLISECOND)
    assert emergencies(node) == [(0x8130, 0x11)]
    assert node.slave.state is NmtState.STOPPED
    node.slave.on_heartbeat(MASTER, 110 * MILLISECOND)
    assert emergencies(node) == []
    node.slave.on_nmt(command, 120 * MILLISECOND)
    assert emergencies(node) == [(0, 0)]
    node.slave.on_nmt(STOP, 130 * MILLISECOND)
    node.slave.on_nmt(command, 140 * MILLISECOND)
    assert emergencies(node) == []


def test_an_error_that_began_in_stopped_is_told_when_stopped_ends(node: Node) -> None:
    node.slave.on_nmt(STOP, 0)
    node.slave.on_error_state(ErrorState.PASSIVE, 0)
    assert emergencies(node) == []
    node.slave.on_nmt(NmtCommand.PRE_OPERATIONAL, MILLISECOND)
    assert emergencies(node) == [(0x8120, 0x11)]
