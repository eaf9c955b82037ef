"""PDOs of one node in virtual time, by raw frames, against CiA 301: when they act, and how they are changed."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm_protocol.canopen.frames import Frame, NmtCommand
from canarm_protocol.canopen.sdo import SdoAborted, download
from tests.emulator.lone_node import (
    INVALID,
    NO_OBJECT,
    NO_SUBINDEX,
    NOT_MAPPABLE,
    PDO_TOO_LONG,
    START,
    STATE,
    UNSUPPORTED,
    Node,
    outputs_frame,
)

# PDO (CiA 301, 7.2.2)


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
