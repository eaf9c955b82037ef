"""One node in virtual time, by raw frames, against CiA 301: NMT, SDO and boot time."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm_emulator.cards.dac0808 import Dac0808Card
from canarm_emulator.cards.device import DacDevice
from canarm_emulator.node.slave import Slave
from canarm_emulator.timing import NEVER
from canarm_protocol.canopen.frames import Frame, NmtCommand, NmtState
from canarm_protocol.canopen.sdo import SdoAborted, upload
from tests.emulator.lone_node import (
    INVALID,
    LENGTH,
    MASTER,
    MILLISECOND,
    NO_OBJECT,
    NO_SUBINDEX,
    NODE_ID,
    READ_ONLY,
    START,
    STATE,
    STOP,
    TOO_HIGH,
    TOO_LONG,
    TOO_LOW,
    Node,
    PowerOn,
    dictionary_of,
)

# NMT (CiA 301, 7.2.8)


def test_boot_up_is_sent_and_pre_operational_entered_by_itself(node: Node) -> None:
    assert node.take() == [(0, Frame(0x712, b"\0"))]
    assert node.slave.state is NmtState.PRE_OPERATIONAL
    assert node.slave.next_due_ns == NEVER


def test_every_transition_of_the_nmt_state_machine(node: Node) -> None:
    steps = [
        (START, NmtState.OPERATIONAL),
        (NmtCommand.PRE_OPERATIONAL, NmtState.PRE_OPERATIONAL),
        (STOP, NmtState.STOPPED),
        (START, NmtState.OPERATIONAL),
        (START, NmtState.OPERATIONAL),
        (STOP, NmtState.STOPPED),
        (NmtCommand.PRE_OPERATIONAL, NmtState.PRE_OPERATIONAL),
        (NmtCommand.RESET_NODE, NmtState.PRE_OPERATIONAL),
        (START, NmtState.OPERATIONAL),
        (NmtCommand.RESET_COMMUNICATION, NmtState.PRE_OPERATIONAL),
        (STOP, NmtState.STOPPED),
        (NmtCommand.RESET_NODE, NmtState.PRE_OPERATIONAL),
    ]
    for command, state in steps:
        node.take()
        node.slave.on_nmt(command, 5)
        assert node.slave.state is state
        is_reset = command in (NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION)
        assert node.take() == ([(5, Frame(0x712, b"\0"))] if is_reset else [])


def test_reset_node_forgets_all_and_reset_communication_only_communication(node: Node) -> None:
    node.write(0x1017, 0, 100, 2)
    node.write(0x6444, 1, 0x1000_0000, 4)
    node.slave.on_nmt(NmtCommand.RESET_COMMUNICATION, 0)
    assert (node.read(0x1017), node.read(0x6444, 1)) == (0, 0x1000_0000)
    assert node.slave.next_due_ns == NEVER
    node.slave.on_nmt(NmtCommand.RESET_NODE, 0)
    assert node.read(0x6444, 1) == 0


def test_stopping_a_node_gives_its_outputs_their_error_values(node: Node) -> None:
    """CiA 401, 0x6443: in case of an internal failure or a stop of the remote node."""
    node.slave.on_nmt(START, 0)
    for channel in range(1, 5):
        node.write(0x6411, channel, 0x7F80, 2)
    node.slave.on_nmt(STOP, 0)
    assert node.outputs() == [0, 0, 0, 0]


# SDO (CiA 301, 7.2.4)


def test_sdo_is_served_in_every_state_but_stopped(node: Node) -> None:
    request = next(upload(0x1000, 0))
    for command, answers in ((NmtCommand.PRE_OPERATIONAL, 1), (START, 1), (STOP, 0)):
        node.slave.on_nmt(command, 0)
        node.take()
        node.slave.on_sdo(0x612, request, 3)
        assert len(node.take()) == answers
    assert node.slave.ignored_frames == 1


def test_expedited_and_segmented_uploads(node: Node) -> None:
    assert node.read(0x1000) == 0x0008_0191
    assert node.sdo(upload(0x1008, 0)) == b"DAC0808 card"
    assert node.read(0x1018, 4) == NODE_ID
    assert node.read(0x2000) == 1


@pytest.mark.parametrize(
    ("index", "subindex", "data", "code"),
    [
        (0x1000, 0, b"\0\0\0\0", READ_ONLY),
        (0x1008, 0, b"a longer name", READ_ONLY),
        (0x1234, 0, b"\0", NO_OBJECT),
        (0x1017, 1, b"\0\0", NO_SUBINDEX),
        (0x6411, 5, b"\0\0", NO_SUBINDEX),
        (0x6411, 0, b"\0", READ_ONLY),
        (0x1017, 0, b"\0", LENGTH),
        (0x1017, 0, b"\0\0\0\0", LENGTH),
        (0x1017, 0, bytes(20), TOO_LONG),
        (0x6411, 1, struct.pack("<h", -1), TOO_LOW),
        (0x6443, 1, b"\x02", TOO_HIGH),
        (0x1029, 1, b"\x03", TOO_HIGH),
        (0x1005, 0, b"\x81\0\0\0", INVALID),
        (0x1005, 0, b"\x80\0\0\x40", INVALID),  # bit 30: SYNC producer
        (0x1005, 0, b"\x80\0\0\x20", INVALID),  # bit 29: 29-bit identifier
        (0x1019, 0, b"\xf1", TOO_HIGH),
        (0x1019, 0, b"\x01", INVALID),
        (0x1003, 0, b"\x01", INVALID),
    ],
)
def test_a_wrong_download_is_aborted_with_the_code_of_cia_301(
    node: Node, index: int, subindex: int, data: bytes, code: int
) -> None:
    assert node.refused(index, subindex, data) == code


@pytest.mark.parametrize(("index", "subindex", "code"), [(0x1234, 0, NO_OBJECT), (0x6411, 5, NO_SUBINDEX)])
def test_a_wrong_upload_is_aborted_with_the_code_of_cia_301(node: Node, index: int, subindex: int, code: int) -> None:
    with pytest.raises(SdoAborted) as caught:
        node.read(index, subindex)
    assert caught.value.code == code


def test_the_sync_counter_is_fixed_once_the_cycle_is_set(node: Node) -> None:
    """CiA 301, 7.5.2.22: 0x1019 is changed only while 0x1006 is 0."""
    node.write(0x1019, 0, 20, 1)
    node.write(0x1006, 0, 2500, 4)
    assert node.refused(0x1019, 0, b"\x14") == STATE


def exchange(node: Node, *requests: str) -> list[str]:
    """Answers (hex) to requests that no proper client would make."""
    node.take()
    for request in requests:
        node.slave.on_sdo(0x612, bytes.fromhex(request), 0)
    return [frame.data.hex() for _, frame in node.take()]


@pytest.mark.parametrize(
    ("requests", "answers"),
    [
        (["6000000000000000"], ["8000000001000405"]),  # a segment of nothing
        (["4017100000000000", "1164000000000000"], ["4b17100000000000", "8000000001000405"]),  # names nothing
        (["4008100000000000", "7000000000000000"], ["410810000c000000", "8008100000000305"]),  # wrong toggle
        (["4008100000000000", "0000000000000000"], ["410810000c000000", "8008100001000405"]),  # wrong direction
        (["2117100002000000", "0000000000000000"], ["6017100000000000", "8017100012000706"]),  # more than announced
        (["2017100000000000", "0000000000000000"], ["6017100000000000", "8017100012000706"]),  # more than the object
        (["2117100002000000", "0d00000000000000"], ["6017100000000000", "8017100010000706"]),  # less than announced
        (["2117100003000000", "0d00000000000000"], ["8017100012000706", "8000000001000405"]),  # announces too much
        (["2117100001000000"], ["8017100013000706"]),  # announces too little
        (["21171000ffffffff"], ["8017100012000706"]),
        (["a017100000000000"], ["8017100002000405"]),  # block upload, no segments wanted
        (["c217100000000000"], ["8017100013000706"]),  # block download of nothing
        (["e017100000000000"], ["8017100001000405"]),
        (["8017100000000405"], []),
        (["4008100000000000", "8008100000000405", "6000000000000000"], ["410810000c000000", "8000000001000405"]),
        (["2217100064000000"], ["6017100000000000"]),  # expedited without a size: as many bytes as the object has
    ],
)
def test_requests_out_of_order_are_aborted(node: Node, requests: list[str], answers: list[str]) -> None:
    assert exchange(node, *requests) == answers
    assert node.read(0x1000) == 0x0008_0191


def test_a_download_is_refused_at_its_first_frame_where_nothing_can_be_written(node: Node) -> None:
    assert exchange(node, "2108100014000000") == ["8008100002000106"]


@given(st.lists(st.binary(max_size=9), max_size=12))
def test_no_sdo_frame_makes_the_server_fail(frames: list[bytes]) -> None:
    node = Node()
    for data in frames:
        node.slave.on_sdo(0x612, data, 0)
    assert node.slave.ignored_frames == sum(len(data) != 8 for data in frames)
    assert all(frame.can_id == 0x592 and len(frame.data) == 8 for _, frame in node.take()[1:])
    assert node.read(0x1000) == 0x0008_0191


def test_a_card_holds_its_eds() -> None:
    sent: list[Frame] = []
    device = DacDevice(Dac0808Card(lambda channel, fraction: None), 8, 4, PowerOn())
    dictionary = dictionary_of("dac0808")
    slave = Slave("dac", NODE_ID, dictionary, device, lambda _, frame: sent.append(frame), 1, b"[FileInfo]")
    slave.boot(0)
    slave.on_sdo(0x612, bytes.fromhex("4021100000000000"), 0)
    slave.on_sdo(0x612, bytes.fromhex("6000000000000000"), 0)
    assert [frame.data[1:] for frame in sent[1:]] == [b"\x21\x10\0\x0a\0\0\0", b"[FileIn"]


# Boot time


def test_a_card_that_takes_its_time_to_boot_is_silent_and_safe_until_its_boot_up(node: Node) -> None:
    node.slave.boot_ns = 10 * MILLISECOND
    node.write(0x1017, 0, 4, 2)
    node.slave.on_nmt(START, 0)
    node.rpdo(b"\0\x22" + bytes(6))
    node.slave.on_sync(b"", 0)
    node.take()
    node.slave.on_nmt(NmtCommand.RESET_NODE, 5)
    assert node.slave.next_due_ns == 5 + 10 * MILLISECOND
    assert node.outputs() == [0, 0, 0, 0]
    node.slave.on_sdo(0x612, bytes.fromhex("4000100000000000"), 6)
    node.slave.on_nmt(START, 7)
    node.slave.on_sync(b"", 8)
    node.slave.on_heartbeat(MASTER, 9)
    node.slave.on_remote(0x700 + NODE_ID, 10)
    node.run_until(9 * MILLISECOND)
    assert node.take() == []
    node.run_until(10 * MILLISECOND + 5)
    assert node.take() == [(10 * MILLISECOND + 5, Frame(0x700 + NODE_ID, b"\0"))]
    assert node.slave.state is NmtState.PRE_OPERATIONAL
    assert node.read(0x1017) == 0
