"""SDO server (CiA 301, 7.2.4) and the rules of objects: access, size, limits, abort codes, storing and restoring."""

import struct

import canopen
import pytest

START, RESET_NODE = 0x01, 0x81
DAC, LATCH, ADC = 0x12, 0x13, 0x14
PRODUCT = {DAC: (b"DAC0808 card", 0x808), LATCH: (b"SC300 direction latch", 0x300), ADC: (b"ADC0809 card", 0x809)}


# The library's client ends an aborted segmented download from its finaliser, in whatever thread that runs: downloads
# that are to fail have four bytes at most here, or are raw frames.


def code_of(action) -> int:
    with pytest.raises(canopen.SdoAbortedError) as caught:
        action()
    return caught.value.code


@pytest.mark.parametrize("node_id", [DAC, LATCH, ADC])
def test_every_object_of_the_eds_is_read_with_its_access_and_size(link, node_id: int) -> None:
    """CiA 306: the EDS describes what is there."""
    node = link.card(node_id)
    for entry in node.object_dictionary.values():
        is_variable = isinstance(entry, canopen.objectdictionary.ODVariable)
        for variable in [entry] if is_variable else entry.subindices.values():
            if (variable.index, variable.subindex > 0) == (0x1003, True):  # none has happened yet
                assert code_of(lambda: node.sdo.upload(0x1003, 1)) == 0x0800_0024
                continue
            data = node.sdo.upload(variable.index, variable.subindex)
            assert not variable.fixed_size or 8 * len(data) == len(variable), variable
            if not variable.writable:
                head = struct.pack("<HB", variable.index, variable.subindex).hex()
                assert link.exchange(node_id, f"22{head}00000000") == f"80{head}02000106"


@pytest.mark.parametrize("node_id", [DAC, LATCH, ADC])
def test_identity_and_names(link, node_id: int) -> None:
    """0x1000, 0x1008 (segmented upload, 7.2.4.3.6 and 7.2.4.3.7), 0x1018."""
    node = link.card(node_id)
    name, product = PRODUCT[node_id]
    assert node.sdo.upload(0x1008, 0) == name
    assert node.sdo[0x1000].raw & 0xFFFF == 401
    assert (node.sdo[0x1018][2].raw, node.sdo[0x1018][4].raw) == (product, node_id)


def test_a_segmented_download_writes_as_an_expedited_one(link) -> None:
    """7.2.4.3.3 and 7.2.4.3.4."""
    node = link.card(DAC)
    node.sdo.download(0x6444, 1, (0x1234_5678).to_bytes(4, "little"), force_segment=True)
    assert node.sdo[0x6444][1].raw == 0x1234_5678
    node.sdo[0x6444][1].raw = -2
    assert node.sdo[0x6444][1].raw == -2


@pytest.mark.parametrize(
    ("node_id", "index", "subindex", "data", "code"),
    [
        (DAC, 0x1000, 0, b"\0\0\0\0", 0x0601_0002),  # read-only
        (ADC, 0x6401, 1, b"\0\0", 0x0601_0002),
        (DAC, 0x5FFF, 0, b"\0", 0x0602_0000),  # no object
        (DAC, 0x6411, 5, b"\0\0", 0x0609_0011),  # no sub-index
        (DAC, 0x1017, 1, b"\0\0", 0x0609_0011),
        (DAC, 0x1017, 0, b"\0", 0x0607_0010),  # length
        (DAC, 0x1017, 0, bytes(4), 0x0607_0010),
        (DAC, 0x6411, 1, b"\xff\xff", 0x0609_0032),  # too low
        (DAC, 0x6410, 1, b"\x80", 0x0609_0032),
        (DAC, 0x6443, 1, b"\x02", 0x0609_0031),  # too high
        (ADC, 0x6421, 8, b"\x20", 0x0609_0031),
        (ADC, 0x2010, 0, b"\0\0", 0x0609_0032),
        (LATCH, 0x1029, 1, b"\x03", 0x0609_0031),
        (LATCH, 0x1019, 0, b"\xf1", 0x0609_0031),
        (LATCH, 0x1019, 0, b"\x01", 0x0609_0030),  # reserved
        (LATCH, 0x1003, 0, b"\x01", 0x0609_0030),
        (LATCH, 0x1005, 0, b"\x80\0\0\x40", 0x0609_0030),
        (LATCH, 0x1014, 0, b"\x92\x08\0\0", 0x0609_0030),
        (LATCH, 0x1010, 1, b"load", 0x0800_0020),  # wrong signature
        (LATCH, 0x1011, 1, b"save", 0x0800_0020),
    ],
)
def test_a_wrong_download_is_aborted_with_its_code(link, node_id, index, subindex, data, code) -> None:
    """7.2.4.3.17, table 22."""
    node = link.card(node_id)
    assert code_of(lambda: node.sdo.download(index, subindex, data)) == code
    assert node.sdo[0x1000].raw & 0xFFFF == 401


@pytest.mark.parametrize(("index", "subindex", "code"), [(0x5FFF, 0, 0x0602_0000), (0x1018, 5, 0x0609_0011)])
def test_a_wrong_upload_is_aborted_with_its_code(link, index, subindex, code) -> None:
    """7.2.4.3.17, table 22."""
    node = link.card(LATCH)
    assert code_of(lambda: node.sdo.upload(index, subindex)) == code


@pytest.mark.parametrize(
    ("requests", "answers"),
    [
        (["4008100000000000", "7000000000000000"], ["410810000c000000", "8008100000000305"]),  # toggle bit
        (["4008100000000000", "0000000000000000"], ["410810000c000000", "8008100001000405"]),  # a download's segment
        (["6000000000000000"], ["8000000001000405"]),  # a segment of nothing
        (["2117100002000000", "0000000000000000"], ["6017100000000000", "8017100012000706"]),  # more than the object
        (["2117100002000000", "0d00000000000000"], ["6017100000000000", "8017100010000706"]),  # less than announced
        (["2117100003000000"], ["8017100012000706"]),  # announces more than the object, less
        (["2117100001000000"], ["8017100013000706"]),
        (["2117100002000000", "1b32000000000000"], ["6017100000000000", "8017100000000305"]),
        (["a017100000000000"], ["8017100002000405"]),  # block upload of no segments
        (["c217100000000000"], ["8017100013000706"]),  # block download that announces less than the object has
        (["a017100001000000", "a100000000000000"], ["c217100002000000", "8017100001000405"]),  # its end too early
        (["e017100000000000"], ["8017100001000405"]),
    ],
)
def test_requests_out_of_order_are_aborted_and_the_channel_stays_usable(link, requests, answers) -> None:
    """7.2.4.3: command specifiers, toggle bit, sizes."""
    assert [link.exchange(DAC, request) for request in requests] == answers
    assert link.exchange(DAC, "4000100000000000").startswith("4300100091010800")


def test_a_transfer_can_be_cut_anywhere_and_the_next_one_starts_anew(link) -> None:
    """7.2.4.3.17: a client's abort has no answer; a new initiate ends what was under way."""
    link.exchange(DAC, "4008100000000000")
    link.send(0x600 + DAC, bytes.fromhex("8008100000000405"))
    assert link.exchange(DAC, "6000000000000000") == "8000000001000405"
    link.exchange(DAC, "4008100000000000")
    assert link.exchange(DAC, "4018100200000000") == "4318100208080000"


@pytest.mark.parametrize("length", [0, 1, 7])
def test_a_request_that_has_not_eight_bytes_is_not_answered(link, length: int) -> None:
    """7.2.4.3: SDO messages have eight bytes."""
    link.send(0x600 + DAC, bytes(length))
    link.exchange(ADC, "4000100000000000")
    assert link.data(0x580 + DAC) == []


@pytest.mark.parametrize(("subindex", "heartbeat", "error_mode"), [(1, 70, 0), (2, 70, 1), (3, 0, 0)])
def test_saved_parameters_outlast_a_reset_until_their_defaults_are_restored(
    link, subindex: int, heartbeat: int, error_mode: int
) -> None:
    """0x1010 and 0x1011: all, communication, application parameters."""
    dac = link.card(DAC)
    dac.sdo[0x1017].raw = 70
    dac.sdo[0x6443][2].raw = 0
    try:
        dac.sdo.download(0x1010, subindex, b"save")
        assert dac.sdo[0x1010][subindex].raw == 1
        link.reset()
        dac = link.card(DAC)
        assert (dac.sdo[0x1017].raw, dac.sdo[0x6443][2].raw) == (heartbeat, error_mode)
        if heartbeat:
            link.await_frames(0x700 + DAC)
    finally:
        dac.sdo.download(0x1011, 1, b"load")
    assert (dac.sdo[0x1017].raw, dac.sdo[0x6443][2].raw) == (heartbeat, error_mode)  # until the next reset
    link.reset()
    dac = link.card(DAC)
    assert (dac.sdo[0x1017].raw, dac.sdo[0x6443][2].raw) == (0, 1)
