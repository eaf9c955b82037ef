"""PDOs (CiA 301, 7.2.2 and 7.5.2.35 to 7.5.2.38): transmission types, timers, RTR, changes by SDO."""

import struct

import canopen
import pytest

START, STOP, PRE_OPERATIONAL, RESET_NODE = 0x01, 0x02, 0x80, 0x81
DAC, LATCH, ADC = 0x12, 0x13, 0x14
TPDO2, TPDO3 = 0x280 + ADC, 0x380 + ADC
INVALID, STATE, UNSUPPORTED = 0x0609_0030, 0x0800_0022, 0x0601_0000
UPLOAD_DEVICE_TYPE = "4000100000000000"


def code_of(action) -> int:
    with pytest.raises(canopen.SdoAbortedError) as caught:
        action()
    return caught.value.code


def configure(node: canopen.RemoteNode, communication: int, **values: int) -> None:
    """Sub-indices of a communication parameter, set while the PDO is disabled."""
    subindices = {"kind": 2, "inhibit_100us": 3, "event_ms": 5, "start": 6}
    record = node.sdo[communication]
    cob_id = record[1].raw
    record[1].raw = cob_id | 0x8000_0000
    for name, value in values.items():
        record[subindices[name]].raw = value
    record[1].raw = cob_id


def outputs(node: canopen.RemoteNode) -> list[int]:
    return [node.sdo[0x6411][channel].raw >> 7 for channel in range(1, 5)]


@pytest.mark.parametrize("kind", [0, 1, 240])
def test_a_synchronous_rpdo_acts_at_the_next_sync_and_the_last_one_counts(link, kind: int) -> None:
    """0x1401:2, types 0 to 240."""
    dac = link.card(DAC)
    configure(dac, 0x1401, kind=kind)
    link.nmt(START, DAC)
    link.send(0x300 + DAC, struct.pack("<4h", *[code << 7 for code in (9, 9, 9, 9)]))
    link.send(0x300 + DAC, struct.pack("<4h", *[code << 7 for code in (1, 2, 3, 255)]))
    assert outputs(dac) == [0, 0, 0, 0]
    link.sync()
    assert outputs(dac) == [1, 2, 3, 255]


@pytest.mark.parametrize("kind", [254, 255])
def test_an_event_driven_rpdo_acts_at_once(link, kind: int) -> None:
    """0x1400:2, types 254 and 255."""
    latch = link.card(LATCH)
    configure(latch, 0x1400, kind=kind)
    link.nmt(START, LATCH)
    link.send(0x200 + LATCH, b"\x05")
    assert latch.sdo[0x6200][1].raw == 5


@pytest.mark.parametrize(("kind", "sent"), [(1, "111111"), (2, "010101"), (3, "001001"), (240, "000000")])
def test_a_tpdo_of_type_n_follows_every_nth_sync(link, kind: int, sent: str) -> None:
    """0x1801:2, types 1 to 240; TPDO3 at every SYNC shows when TPDO2 would have come."""
    configure(link.card(ADC), 0x1801, kind=kind)
    link.nmt(START, ADC)
    seen, count = "", 0
    for _ in sent:
        link.cycle(TPDO3)
        now = len(link.data(TPDO2))
        seen, count = seen + str(now - count), now
    assert seen == sent


def test_a_tpdo_of_type_0_follows_a_sync_only_after_its_data_have_changed(link) -> None:
    """0x1801:2, type 0 (acyclic); the error register is what it maps."""
    adc = link.card(ADC)
    write_mapping(adc, 0x1801, [0x10010008])
    configure(adc, 0x1801, kind=0)
    adc.sdo[0x1029][1].raw = 1
    link.nmt(START, ADC)
    for _ in range(3):
        link.cycle(TPDO3)
    assert link.data(TPDO2) == [b"\0"]
    link.send(0x080, b"\x01")  # with a counter, which nobody asked for: EMCY 0x8240
    link.await_frames(0x080 + ADC)
    link.await_frames(TPDO2, 2)
    link.cycle(TPDO3)
    assert link.await_frames(TPDO2, 3) == [b"\0", b"\x11", b"\0"]


def test_the_sync_start_value_says_which_counter_is_the_first(link) -> None:
    """0x1801:6 with 0x1019: the nth SYNC from that one on."""
    link.card(ADC).sdo[0x1019].raw = 240
    configure(link.card(ADC), 0x1801, kind=2, start=30)
    link.nmt(START, ADC)
    counters = []
    for counter in (28, 29, 30, 31, 32, 33):
        link.cycle(TPDO3, counter)
        if len(link.data(TPDO2)) > len(counters):
            counters.append(counter)
    assert counters == [31, 33]


@pytest.mark.parametrize("kind", [254, 255])
def test_the_event_timer_sends_a_tpdo_again_and_again(link, kind: int) -> None:
    """0x1801:5."""
    configure(link.card(ADC), 0x1801, kind=kind, event_ms=20)
    link.nmt(START, ADC)
    assert {len(data) for data in link.await_frames(TPDO2, 4)} == {8}


def test_without_timer_and_interrupts_an_event_driven_tpdo_stays_silent(link) -> None:
    """0x6423 is FALSE after a reset (CiA 401)."""
    configure(link.card(ADC), 0x1801, kind=255)
    link.nmt(START, ADC)
    for _ in range(3):
        link.cycle(TPDO3)
    assert link.data(TPDO2) == []


def test_a_sampled_tpdo_waits_for_a_remote_frame(link) -> None:
    """0x1801:2, type 252: sampled at SYNC, sent on RTR."""
    configure(link.card(ADC), 0x1801, kind=252)
    link.nmt(START, ADC)
    link.cycle(TPDO3)
    assert link.data(TPDO2) == []
    link.send(TPDO2, remote=True)
    assert len(link.await_answer(TPDO2)) == 8


@pytest.mark.parametrize("kind", [0, 1, 253, 254])
def test_a_remote_frame_is_answered_by_the_tpdo(link, kind: int) -> None:
    """0x1801:1, bit 30 = 0; type 253: sampled and sent on RTR; other types may be asked for too."""
    configure(link.card(ADC), 0x1801, kind=kind)
    link.nmt(START, ADC)
    link.send(TPDO2, remote=True)
    assert len(link.await_answer(TPDO2)) == 8


def test_a_remote_frame_is_not_answered_where_bit_30_forbids_it_or_out_of_operational(link) -> None:
    """0x1801:1, bit 30 = 1."""
    adc = link.card(ADC)
    link.send(TPDO2, remote=True)
    adc.sdo[0x1801][1].raw = 0x4000_0000 | TPDO2
    link.nmt(START, ADC)
    link.send(TPDO2, remote=True)
    link.exchange(ADC, UPLOAD_DEVICE_TYPE)
    assert link.data(TPDO2) == []


def test_remote_frames_elsewhere_do_nothing(link) -> None:
    """RPDOs, SDO, NMT and SYNC are not asked for."""
    link.nmt(START)
    for can_id in (0x300 + DAC, 0x600 + DAC, 0x000, 0x080):
        link.send(can_id, remote=True)
    link.exchange(DAC, UPLOAD_DEVICE_TYPE)
    assert {message.arbitration_id for message in link.heard} <= {0x100, 0x580 + DAC}


# Changes by SDO


def write_mapping(node: canopen.RemoteNode, communication: int, entries: list[int]) -> None:
    mapping = communication + 0x200
    cob_id = node.sdo[communication][1].raw
    node.sdo[communication][1].raw = cob_id | 0x8000_0000
    node.sdo[mapping][0].raw = 0
    for number, entry in enumerate(entries, 1):
        node.sdo[mapping][number].raw = entry
    node.sdo[mapping][0].raw = len(entries)
    node.sdo[communication][1].raw = cob_id


def test_the_library_maps_and_moves_a_tpdo(link) -> None:
    """python-canopen's PDO maps: 0x1801 and 0x1A01 by SDO, then the frame as asked for."""
    adc = link.card(ADC)
    adc.tpdo.read()
    adc.tpdo[2].clear()
    adc.tpdo[2].add_variable("Read analogue input 16-bit", "Analogue input 2")
    adc.tpdo[2].add_variable("Read analogue input 8-bit", "Analogue input 2")
    adc.tpdo[2].add_variable("Error register")
    adc.tpdo[2].cob_id = 0x1A5
    adc.tpdo[2].trans_type = 1
    adc.tpdo.save()
    link.nmt(START, ADC)
    wide, narrow, register = struct.unpack("<hbB", link.cycle(0x1A5))
    assert (narrow, register) == (wide >> 8, 0)
    link.cycle(TPDO3)
    assert link.data(TPDO2) == []


def test_a_disabled_pdo_is_not_there(link) -> None:
    """0x1801:1 and 0x1401:1, bit 31."""
    adc, dac = link.card(ADC), link.card(DAC)
    adc.sdo[0x1801][1].raw = 0x8000_0000 | TPDO2
    dac.sdo[0x1401][1].raw = 0x8000_0000 | 0x312
    link.nmt(START)
    link.send(0x312, b"\x80\x00" * 4)
    link.cycle(TPDO3)
    assert link.data(TPDO2) == []
    assert outputs(dac) == [0, 0, 0, 0]


def test_a_mapping_is_changed_only_while_the_pdo_is_disabled_and_maps_nothing(link) -> None:
    """7.5.2.38."""
    sdo = link.card(ADC).sdo
    entry = (0x64010110).to_bytes(4, "little")
    assert code_of(lambda: sdo.download(0x1A01, 0, b"\0")) == STATE
    assert code_of(lambda: sdo.download(0x1A01, 1, entry)) == STATE
    sdo[0x1801][1].raw = 0x8000_0000 | TPDO2
    assert code_of(lambda: sdo.download(0x1A01, 1, entry)) == UNSUPPORTED
    sdo[0x1A01][0].raw = 0
    sdo.download(0x1A01, 1, entry)


@pytest.mark.parametrize(
    ("entry", "code"),
    [(0x5FFF0010, 0x0602_0000), (0x64010910, 0x0609_0011), (0x10170010, 0x0604_0041), (0x64010108, 0x0604_0041)],
)
def test_what_cannot_be_mapped_is_refused(link, entry: int, code: int) -> None:
    """7.5.2.38, abort codes 0604 0041h and those of missing objects."""
    sdo = link.card(ADC).sdo
    sdo[0x1801][1].raw = 0x8000_0000 | TPDO2
    sdo[0x1A01][0].raw = 0
    assert code_of(lambda: sdo.download(0x1A01, 1, entry.to_bytes(4, "little"))) == code


def test_more_than_can_be_mapped_is_refused(link) -> None:
    """7.5.2.38, abort code 0604 0042h."""
    sdo = link.card(ADC).sdo
    sdo[0x1801][1].raw = 0x8000_0000 | TPDO2
    sdo[0x1A01][0].raw = 0
    assert code_of(lambda: sdo.download(0x1A01, 0, b"\x05")) == 0x0604_0042


def test_an_input_cannot_be_mapped_into_an_rpdo(link) -> None:
    """7.5.2.36."""
    sdo = link.card(DAC).sdo
    sdo[0x1401][1].raw = 0x8000_0000 | 0x312
    sdo[0x1601][0].raw = 0
    assert code_of(lambda: sdo.download(0x1601, 1, (0x10010008).to_bytes(4, "little"))) == 0x0604_0041


def test_a_cob_id_is_changed_by_way_of_a_disabled_pdo(link) -> None:
    """7.5.2.35: bits 0 to 29 stay while bit 31 is 0."""
    dac = link.card(DAC)
    assert code_of(lambda: dac.sdo.download(0x1401, 1, struct.pack("<I", 0x313))) == INVALID
    dac.sdo[0x1401][1].raw = 0x8000_0000
    for other in (0x000, 0x080, 0x601, 0x712, 0x800, 0x2000_0312):
        assert code_of(lambda o=other: dac.sdo.download(0x1401, 1, struct.pack("<I", o))) == INVALID
    dac.sdo[0x1401][1].raw = 0x313
    link.nmt(START, DAC)
    link.send(0x312, b"\x80\x00" * 4)
    link.send(0x313, b"\x80\x01" * 4)
    link.sync()
    assert outputs(dac) == [3, 3, 3, 3]


@pytest.mark.parametrize(("subindex", "data"), [(3, b"\x01\0"), (6, b"\x01")])
def test_inhibit_time_and_sync_start_value_are_fixed_while_the_pdo_is_enabled(link, subindex, data) -> None:
    """7.5.2.37."""
    sdo = link.card(ADC).sdo
    assert code_of(lambda: sdo.download(0x1801, subindex, data)) == STATE
    sdo[0x1801][1].raw = 0x8000_0000 | TPDO2
    sdo.download(0x1801, subindex, data)


@pytest.mark.parametrize(("index", "kind"), [(0x1801, 241), (0x1801, 251)])
def test_reserved_transmission_types_are_refused(link, index: int, kind: int) -> None:
    """0x1801:2, 241 to 251."""
    assert code_of(lambda: link.card(ADC).sdo.download(index, 2, bytes((kind,)))) == INVALID


@pytest.mark.parametrize("kind", [241, 252, 253])
def test_transmission_types_that_an_rpdo_does_not_have_are_refused(link, kind: int) -> None:
    """0x1401:2."""
    assert code_of(lambda: link.card(DAC).sdo.download(0x1401, 2, bytes((kind,)))) == INVALID


def test_pdos_are_not_changed_in_operational(link) -> None:
    """7.5.2.38: in PRE-OPERATIONAL, and in OPERATIONAL where a device supports it; these do not."""
    sdo = link.card(ADC).sdo
    link.nmt(START, ADC)
    for index, subindex, data in ((0x1801, 1, bytes(4)), (0x1801, 2, b"\1"), (0x1801, 5, b"\1\0"), (0x1A01, 0, b"\0")):
        assert code_of(lambda i=index, s=subindex, d=data: sdo.download(i, s, d)) == STATE


def test_a_longer_rpdo_is_taken_and_a_shorter_one_is_an_error(link) -> None:
    """7.5.2.36, EMCY 0x8210."""
    dac = link.card(DAC)
    link.nmt(START, DAC)
    link.send(0x312, bytes(7))
    assert link.await_frames(0x080 + DAC) == [bytes.fromhex("1082110000000000")]
    link.card(LATCH)
    link.nmt(START, LATCH)
    link.send(0x213, b"\x01\xff")
    link.send(0x312, b"\x80\0" * 4)
    assert link.await_frames(0x080 + DAC, 2)[1] == bytes(8)
    link.sync()
    assert outputs(dac) == [1, 1, 1, 1]
    assert link.card(LATCH).sdo[0x6200][1].raw == 1
