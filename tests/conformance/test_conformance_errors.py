"""Heartbeat both ways (CiA 301, 7.2.8.3.2.2), EMCY (7.2.7), error register and history, error behaviour."""

import struct

import pytest

START, STOP, PRE_OPERATIONAL, RESET_NODE = 0x01, 0x02, 0x80, 0x81
DAC, LATCH, ADC = 0x12, 0x13, 0x14
MASTER_HEARTBEAT = 0x701
LOST, OVER = bytes.fromhex("3081110000000000"), bytes(8)
UPLOAD_DEVICE_TYPE = "4000100000000000"


def watch(node, time_ms: int = 50) -> None:
    node.sdo[0x1016][1].raw = 1 << 16 | time_ms


def test_a_node_produces_heartbeats_as_long_as_0x1017_is_not_0(link) -> None:
    """0x1017."""
    node = link.card(DAC)
    node.sdo[0x1017].raw = 10
    assert link.await_frames(0x700 + DAC, 3) == [b"\x7f"] * 3
    node.sdo[0x1017].raw = 0
    count = len(link.data(0x700 + DAC))
    link.card(ADC).sdo[0x1017].raw = 10
    link.await_frames(0x700 + ADC, 3)
    assert len(link.data(0x700 + DAC)) == count


@pytest.mark.parametrize(("behaviour", "state"), [(0, 127), (1, 5), (2, 4)])
def test_a_lost_heartbeat_brings_emcy_error_values_and_the_error_behaviour(link, behaviour: int, state: int) -> None:
    """0x1016, EMCY 0x8130, 0x1001, 0x1029:1, 0x6443 and 0x6444."""
    dac = link.card(DAC)
    watch(dac)
    dac.sdo[0x1029][1].raw = behaviour
    dac.sdo[0x6444][2].raw = 0x4000_0000
    dac.sdo[0x6443][3].raw = 0
    dac.sdo[0x1017].raw = 10
    link.nmt(START, DAC)
    for channel in range(1, 5):
        dac.sdo[0x6411][channel].raw = 9 << 7
    link.send(MASTER_HEARTBEAT, b"\x05")
    assert link.await_frames(0x080 + DAC) == [LOST]
    count = len(link.data(0x700 + DAC))
    assert link.await_frames(0x700 + DAC, count + 2)[-1] == bytes((state,))
    link.nmt(PRE_OPERATIONAL, DAC)
    assert [dac.sdo[0x6411][channel].raw >> 7 for channel in range(1, 5)] == [0, 128, 9, 0]
    assert dac.sdo[0x1001].raw == 0x11
    assert (dac.sdo[0x1003][0].raw, dac.sdo[0x1003][1].raw) == (1, 0x8130)


def test_monitoring_begins_with_the_first_heartbeat(link) -> None:
    """7.5.2.19."""
    latch = link.card(LATCH)
    watch(latch, 20)
    latch.sdo[0x1017].raw = 10
    link.await_frames(0x700 + LATCH, 8)
    assert link.data(0x080 + LATCH) == []
    link.send(MASTER_HEARTBEAT, b"\x05")
    assert link.await_frames(0x080 + LATCH) == [LOST]


def test_the_library_sees_an_error_begin_and_end(link) -> None:
    """python-canopen's EMCY consumer; 0x1001 falls back to 0."""
    node = link.card(LATCH)
    watch(node, 20)
    link.send(MASTER_HEARTBEAT, b"\x05")
    link.until(lambda: node.emcy.active, "EMCY")
    (lost,) = node.emcy.active
    assert (lost.code, lost.register) == (0x8130, 0x11)
    watch(node, 5000)  # the entry is written again: monitoring begins again
    link.send(MASTER_HEARTBEAT, b"\x05")
    link.until(lambda: not node.emcy.active, "end of the error")
    assert node.sdo[0x1001].raw == 0


def test_the_history_has_the_newest_first_and_is_cleared_by_0(link) -> None:
    """0x1003."""
    dac = link.card(DAC)
    watch(dac, 20)
    dac.sdo[0x1029][1].raw = 1
    link.nmt(START, DAC)
    link.send(0x312, b"")
    link.await_frames(0x080 + DAC, 1)
    link.send(MASTER_HEARTBEAT, b"\x05")
    link.await_frames(0x080 + DAC, 2)
    assert [dac.sdo[0x1003][n].raw for n in range(3)] == [2, 0x8130, 0x8210]
    dac.sdo[0x1003][0].raw = 0
    assert dac.sdo[0x1003][0].raw == 0
    assert link.exchange(DAC, "4003100100000000") == "8003100124000008"  # 0x08000024: no data


def test_switching_monitoring_off_after_a_loss_ends_the_error(link) -> None:
    """0x1016, EMCY 0x0000, 0x1001."""
    dac = link.card(DAC)
    watch(dac, 20)
    link.send(MASTER_HEARTBEAT, b"\x05")
    assert link.await_frames(0x080 + DAC) == [LOST]
    dac.sdo[0x1016][1].raw = 0
    assert link.await_frames(0x080 + DAC, 2) == [LOST, OVER]
    assert dac.sdo[0x1001].raw == 0


def test_a_sync_of_another_length_is_reported_until_a_right_one_comes(link) -> None:
    """0x1019, EMCY 0x8240 (unexpected SYNC data length)."""
    for node_id in (DAC, LATCH):
        link.card(node_id).sdo[0x1019].raw = 240
    link.sync()
    assert link.await_frames(0x080 + DAC) == [bytes.fromhex("4082110000000000")]
    assert link.data(0x080 + ADC) == []  # whose 0x1019 is 0, as a stock master expects it
    link.sync(1)
    link.await_frames(0x080 + ADC)
    assert link.await_frames(0x080 + DAC, 2)[1] == OVER


def test_the_sync_counter_is_fixed_once_the_cycle_is_set(link) -> None:
    """0x1019: changed only while 0x1006 is 0."""
    node = link.card(DAC)
    node.sdo[0x1019].raw = 20
    node.sdo[0x1006].raw = 2500
    assert link.exchange(DAC, "2f19100014000000") == "8019100022000008"


def test_emcy_is_moved_and_switched_off(link) -> None:
    """0x1014: bits 0 to 29 change only while bit 31 is 1."""
    dac = link.card(DAC)
    link.nmt(START, DAC)
    assert link.exchange(DAC, "23141000" + struct.pack("<I", 0x1F0).hex()) == "8014100030000906"
    dac.sdo[0x1014].raw = 0x8000_0092
    link.send(0x312, b"")
    link.send(0x312, bytes(8))
    dac.sdo[0x1014].raw = 0x1F0
    link.send(0x312, b"")
    assert link.await_frames(0x1F0) == [bytes.fromhex("1082110000000000")]
    assert link.data(0x080 + DAC) == []


def test_no_emcy_in_stopped(link) -> None:
    """7.3.2.2.5, table 37; register and history are kept."""
    dac = link.card(DAC)
    watch(dac, 20)
    dac.sdo[0x1017].raw = 10
    link.send(MASTER_HEARTBEAT, b"\x05")
    link.nmt(STOP, DAC)
    link.await_frames(0x700 + DAC, 8)
    assert link.data(0x080 + DAC) == []
    link.nmt(PRE_OPERATIONAL, DAC)
    assert (dac.sdo[0x1001].raw, dac.sdo[0x1003][1].raw) == (0x11, 0x8130)


def test_an_rpdo_that_fails_to_come_is_reported_until_it_comes(link) -> None:
    """0x1401:5, EMCY 0x8250 (RPDO timeout)."""
    dac = link.card(DAC)
    dac.sdo[0x1401][5].raw = 20
    link.nmt(START, DAC)
    link.send(0x312, bytes(8))
    assert link.await_frames(0x080 + DAC) == [bytes.fromhex("5082110000000000")]
    link.send(0x312, bytes(8))
    assert link.await_frames(0x080 + DAC, 2)[1] == OVER


def test_a_stop_gives_the_outputs_their_error_values(link) -> None:
    """0x6206, 0x6207 and 0x6443, 0x6444 (CiA 401): failure or stop of the node."""
    dac, latch = link.card(DAC), link.card(LATCH)
    latch.sdo[0x6206][1].raw, latch.sdo[0x6207][1].raw = 0x0F, 0x05
    link.nmt(START)
    dac.sdo[0x6411][1].raw = 0x7F80
    latch.sdo[0x6200][1].raw = 0xAA
    link.nmt(STOP)
    link.nmt(PRE_OPERATIONAL)
    assert (dac.sdo[0x6411][1].raw, latch.sdo[0x6200][1].raw) == (0, 0xA5)
