"""One node in virtual time, by raw frames, against CiA 301: NMT, SDO, PDO, EMCY and heartbeat; see each part."""

import functools
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm_emulator.cards.adc0809 import Adc0809Card
from canarm_emulator.cards.dac0808 import Dac0808Card
from canarm_emulator.cards.device import AdcDevice, DacDevice
from canarm_emulator.node.slave import Slave
from canarm_emulator.timing import NEVER
from canarm_emulator.wire.confinement import ErrorState
from canarm_protocol.canopen.dictionary import Dictionary, load_dictionary
from canarm_protocol.canopen.frames import Frame, NmtCommand, NmtState
from canarm_protocol.canopen.sdo import SdoAborted, download, upload

NODE_ID = 0x12
MASTER = 1
MILLISECOND = 1_000_000
START, STOP = NmtCommand.START, NmtCommand.STOP
READ_ONLY, NO_OBJECT, NO_SUBINDEX, LENGTH = 0x0601_0002, 0x0602_0000, 0x0609_0011, 0x0607_0010
INVALID, TOO_HIGH, TOO_LOW, STATE, NO_DATA = 0x0609_0030, 0x0609_0031, 0x0609_0032, 0x0800_0022, 0x0800_0024
UNSUPPORTED, NOT_MAPPABLE, PDO_TOO_LONG, TOO_LONG = 0x0601_0000, 0x0604_0041, 0x0604_0042, 0x0607_0012


@functools.cache
def dictionary_of(model: str) -> Dictionary:
    return load_dictionary(model, NODE_ID)


class PowerOn:
    """A clock that stands at power-on."""

    time_ns = 0


class Node:
    """A slave with its card, and what it sent, stamped."""

    def __init__(self, model: str = "dac0808") -> None:
        self.sent: list[tuple[int, Frame]] = []
        self.card = Dac0808Card(lambda channel, fraction: None)
        self.volts = [0.0] * 8
        adc_card = Adc0809Card(self.volts.__getitem__, 5.0, 100_000)
        dac = DacDevice(self.card, 8, 4, PowerOn())
        adc = AdcDevice(adc_card, self.volts.__getitem__, 8, 8, PowerOn())
        self.device = dac if model == "dac0808" else adc
        dictionary = dictionary_of(model)
        self.slave = Slave("card", NODE_ID, dictionary, self.device, lambda t, f: self.sent.append((t, f)), 1)
        self.slave.boot(0)

    def take(self) -> list[tuple[int, Frame]]:
        sent, self.sent = self.sent, []
        return sent

    def sdo(self, transfer, now_ns: int = 0) -> bytes:
        """Runs a client's transfer to its end. Raises `SdoAborted`."""
        request = next(transfer)
        while True:
            self.take()
            self.slave.on_sdo(0x600 + NODE_ID, request, now_ns)
            ((stamp, answer),) = self.take()
            assert (stamp, answer.can_id) == (now_ns, 0x580 + NODE_ID)
            try:
                request = transfer.send(answer.data)
            except StopIteration as done:
                return done.value

    def read(self, index: int, subindex: int = 0) -> int:
        return int.from_bytes(self.sdo(upload(index, subindex)), "little")

    def write(self, index: int, subindex: int, value: int, size: int, now_ns: int = 0) -> None:
        self.sdo(download(index, subindex, value.to_bytes(size, "little", signed=value < 0)), now_ns)

    def refused(self, index: int, subindex: int, data: bytes) -> int:
        with pytest.raises(SdoAborted) as caught:
            self.sdo(download(index, subindex, data))
        assert caught.value.by_server
        return caught.value.code

    def outputs(self) -> list[int]:
        return [self.card.code(channel) for channel in range(4)]

    def rpdo(self, data: bytes, now_ns: int = 0) -> None:
        (layout,) = self.slave.pdos.rpdos
        self.slave.on_rpdo(layout, data, now_ns)

    def run_until(self, until_ns: int) -> None:
        while self.slave.next_due_ns <= until_ns:
            self.slave.run_timers(self.slave.next_due_ns)


@pytest.fixture
def node() -> Node:
    return Node()


@pytest.fixture
def adc() -> Node:
    return Node("adc0809")


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


# PDO (CiA 301, 7.2.2)


def outputs_frame(*codes: int) -> bytes:
    return struct.pack(f"<{len(codes)}h", *[code << 7 for code in codes])


def test_a_synchronous_rpdo_acts_at_the_next_sync_and_the_last_one_counts(node: Node) -> None:
    node.slave.on_nmt(START, 0)
    node.rpdo(outputs_frame(1, 2, 3, 4))
    node.rpdo(outputs_frame(5, 6, 7, 8))
    assert node.outputs() == [0, 0, 0, 0]
    node.slave.pdos.apply_outputs()
    assert node.outputs() == [5, 6, 7, 8]
    node.write(0x6411, 1, 0, 2)
    node.slave.pdos.apply_outputs()
    assert node.outputs() == [0, 6, 7, 8]


@pytest.mark.parametrize("transmission_type", [254, 255])
def test_an_event_driven_rpdo_acts_at_once(node: Node, transmission_type: int) -> None:
    node.write(0x1401, 2, transmission_type, 1)
    node.slave.on_nmt(START, 0)
    node.rpdo(outputs_frame(1, 2, 3, 4))
    assert node.outputs() == [1, 2, 3, 4]


def test_there_are_pdos_in_operational_only(node: Node, adc: Node) -> None:
    assert node.slave.pdos.rpdos == adc.slave.pdos.tpdos == adc.slave.pdos.due() == []
    for each in (node, adc):
        each.slave.on_nmt(START, 0)
    assert len(node.slave.pdos.rpdos) == 1
    assert len(adc.slave.pdos.due()) == 2
    for each in (node, adc):
        each.slave.on_nmt(NmtCommand.PRE_OPERATIONAL, 0)
    assert node.slave.pdos.rpdos == adc.slave.pdos.tpdos == adc.slave.pdos.due() == []


def test_an_rpdo_that_waits_for_sync_does_not_outlive_operational(node: Node) -> None:
    node.slave.on_nmt(START, 0)
    node.rpdo(outputs_frame(1, 2, 3, 4))
    node.slave.on_nmt(NmtCommand.PRE_OPERATIONAL, 0)
    node.slave.on_nmt(START, 0)
    node.slave.pdos.apply_outputs()
    assert node.outputs() == [0, 0, 0, 0]


def test_a_short_rpdo_has_no_effect_but_one_emcy_until_a_good_one_comes(node: Node) -> None:
    """EMCY 0x8210, PDO not processed due to length error (CiA 301, table 26)."""
    node.slave.on_nmt(START, 0)
    node.take()
    for now_ns in (1, 2):
        node.rpdo(bytes(7), now_ns)
    assert node.take() == [(1, Frame(0x92, bytes.fromhex("1082110000000000")))]
    assert node.read(0x1001) == 0x11
    node.rpdo(outputs_frame(1, 2, 3, 4) + b"\xff", 3)
    assert node.take() == [(3, Frame(0x92, bytes(8)))]
    node.slave.pdos.apply_outputs()
    assert node.outputs() == [1, 2, 3, 4]
    assert (node.read(0x1001), node.read(0x1003), node.read(0x1003, 1)) == (0, 1, 0x8210)
    assert node.slave.ignored_frames == 2


@pytest.mark.parametrize(
    ("transmission_type", "sent"), [(1, "1111111"), (2, "0101010"), (3, "0010010"), (240, "0000000")]
)
def test_a_tpdo_of_type_n_is_due_at_every_nth_sync(adc: Node, transmission_type: int, sent: str) -> None:
    adc.write(0x1801, 2, transmission_type, 1)
    adc.slave.on_nmt(START, 0)
    due = [any(layout.number == 2 for layout in adc.slave.pdos.due()) for _ in sent]
    assert due == [digit == "1" for digit in sent]


def test_a_tpdo_of_type_0_is_sent_when_its_data_change(adc: Node) -> None:
    adc.write(0x1801, 2, 0, 1)
    adc.slave.on_nmt(START, 0)
    adc.take()
    sent = []
    for volts in (1.0, 1.0, 2.0, 2.0, 1.0):
        adc.device.scan(0, ((0, 0, 0),), [volts])
        for layout in adc.slave.pdos.due():
            if layout.number == 2:
                adc.slave.pdos.send(layout, 7)
        sent.append([frame.data[:2].hex() for _, frame in adc.take()])
    assert sent == [["8019"], [], ["0033"], [], ["8019"]]


def test_tpdo_data_are_the_last_scan(adc: Node) -> None:
    adc.slave.on_nmt(START, 0)
    adc.take()
    for channel in range(8):
        adc.device.scan(0, ((channel, 0, 0),), [channel * 0.5])
    for layout in adc.slave.pdos.due():
        adc.slave.pdos.send(layout, 42)
    codes = [int(channel * 0.5 / 5.0 * 255 + 0.5) << 7 for channel in range(8)]
    assert adc.take() == [
        (42, Frame(0x292, struct.pack("<4h", *codes[:4]))),
        (42, Frame(0x392, struct.pack("<4h", *codes[4:]))),
    ]


def test_a_tpdo_that_is_no_longer_in_force_is_not_sent(adc: Node) -> None:
    adc.slave.on_nmt(START, 0)
    due = adc.slave.pdos.due()
    adc.slave.on_nmt(NmtCommand.RESET_NODE, 0)
    adc.slave.on_nmt(START, 0)
    adc.take()
    for layout in due:
        adc.slave.pdos.send(layout, 1)
    assert adc.take() == []


def test_an_input_is_live_for_sdo_unless_a_tpdo_shows_its_last_scan(adc: Node) -> None:
    write_mapping(adc, 0x1801, 0x1A01, [0x64010110])
    adc.volts[:] = [5.0] * 8
    assert adc.read(0x6401, 1) == adc.read(0x6401, 2) == 0x7F80
    adc.slave.on_nmt(START, 0)
    adc.device.scan(0, ((0, 0, 0),), [0.0])
    adc.device.scan(0, ((1, 0, 0),), [0.0])
    assert (adc.read(0x6401, 1), adc.read(0x6401, 2)) == (0, 0x7F80)


# Changing PDOs (CiA 301, 7.5.2.35 to 7.5.2.38)


def write_mapping(node: Node, communication: int, mapping: int, entries: list[int]) -> None:
    cob_id = node.read(communication, 1)
    node.write(communication, 1, cob_id | 0x8000_0000, 4)
    node.write(mapping, 0, 0, 1)
    for number, entry in enumerate(entries, 1):
        node.write(mapping, number, entry, 4)
    node.write(mapping, 0, len(entries), 1)
    node.write(communication, 1, cob_id & 0x7FF, 4)


def test_a_changed_mapping_is_what_is_sent(adc: Node) -> None:
    write_mapping(adc, 0x1801, 0x1A01, [0x64010810, 0x10010008, 0x64010110])
    adc.slave.on_nmt(START, 0)
    adc.take()
    adc.device.scan(0, ((7, 0, 0),), [5.0])
    adc.slave.pdos.send(adc.slave.pdos.tpdos[0], 0)
    assert adc.take() == [(0, Frame(0x292, bytes.fromhex("807f" + "00" + "0000")))]


def test_outputs_can_be_mapped_into_a_tpdo_but_inputs_not_into_an_rpdo(node: Node) -> None:
    node.write(0x1401, 1, 0x8000_0312, 4)
    node.write(0x1601, 0, 0, 1)
    assert node.refused(0x1601, 1, (0x10010008).to_bytes(4, "little")) == NOT_MAPPABLE


@pytest.mark.parametrize(
    ("entry", "code"),
    [
        (0x12340010, NO_OBJECT),
        (0x64010910, NO_SUBINDEX),
        (0x00050008, NO_OBJECT),  # no dummy mapping: DummyUsage in the EDS says so
        (0x10170010, NOT_MAPPABLE),
        (0x64010108, NOT_MAPPABLE),
        (0x64010120, NOT_MAPPABLE),
    ],
)
def test_what_cannot_be_mapped_is_refused_when_it_is_written(adc: Node, entry: int, code: int) -> None:
    adc.write(0x1801, 1, 0x8000_0292, 4)
    adc.write(0x1A01, 0, 0, 1)
    assert adc.refused(0x1A01, 1, entry.to_bytes(4, "little")) == code
    adc.write(0x1A01, 0, 4, 1)
    adc.slave.on_nmt(START, 0)


def test_the_number_of_mapped_objects_is_bounded(adc: Node) -> None:
    adc.write(0x1801, 1, 0x8000_0292, 4)
    adc.write(0x1A01, 0, 0, 1)
    assert adc.refused(0x1A01, 0, b"\x05") == PDO_TOO_LONG
    assert adc.refused(0x1A01, 0, b"\xff") == PDO_TOO_LONG


def test_a_mapping_is_changed_only_while_the_pdo_is_disabled_and_its_number_is_0(adc: Node) -> None:
    entry = (0x64010110).to_bytes(4, "little")
    assert adc.refused(0x1A01, 0, b"\0") == STATE
    assert adc.refused(0x1A01, 1, entry) == STATE
    adc.write(0x1801, 1, 0x8000_0292, 4)
    assert adc.refused(0x1A01, 1, entry) == UNSUPPORTED
    adc.write(0x1A01, 0, 0, 1)
    adc.write(0x1A01, 1, 0x64010110, 4)


def test_pdos_are_not_changed_in_operational(adc: Node) -> None:
    adc.slave.on_nmt(START, 0)
    for index, subindex, data in ((0x1801, 1, bytes(4)), (0x1801, 2, b"\1"), (0x1A01, 0, b"\0")):
        assert adc.refused(index, subindex, data) == STATE


@pytest.mark.parametrize("value", [241, 251])
def test_transmission_types_of_nobody_are_refused(adc: Node, value: int) -> None:
    assert adc.refused(0x1801, 2, bytes((value,))) == INVALID


@pytest.mark.parametrize("value", [241, 253])
def test_reserved_transmission_types_are_refused(node: Node, value: int) -> None:
    assert node.refused(0x1401, 2, bytes((value,))) == INVALID


def test_a_cob_id_is_changed_by_way_of_a_disabled_pdo(node: Node) -> None:
    assert node.refused(0x1401, 1, struct.pack("<I", 0x313)) == INVALID
    node.write(0x1401, 1, 0x8000_0312, 4)
    node.write(0x1401, 1, 0x4000_0313, 4)  # bit 30: no remote frames
    node.slave.on_nmt(START, 0)
    assert [layout.cob_id for layout in node.slave.pdos.rpdos] == [0x313]


@pytest.mark.parametrize(
    "cob_id", [0x000, 0x07F, 0x080, 0x100, 0x180, 0x581, 0x612, 0x6E0, 0x712, 0x7FF, 0x800, 0x2000_0312]
)
def test_cob_ids_that_belong_to_others_are_refused(node: Node, cob_id: int) -> None:
    """Restricted CAN-IDs (CiA 301, 7.3.5), SYNC and TIME, and 29-bit ones."""
    node.write(0x1401, 1, 0x8000_0312, 4)
    assert node.refused(0x1401, 1, struct.pack("<I", cob_id)) == INVALID
    node.write(0x1401, 1, 0x0181, 4)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0x1801, 0x1802, 0x1A01, 0x1A02]), st.integers(0, 5), st.binary(min_size=1, max_size=4)
        )
    )
)
def test_no_sequence_of_writes_leaves_pdos_that_cannot_be_served(writes: list[tuple[int, int, bytes]]) -> None:
    adc = Node("adc0809")
    for index, subindex, data in writes:
        try:
            adc.sdo(download(index, subindex, data))
        except SdoAborted:
            continue
    adc.slave.on_nmt(START, 0)
    for layout in adc.slave.pdos.tpdos:
        adc.slave.pdos.send(layout, 0)


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
