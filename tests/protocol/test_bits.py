"""Bits on the wire, against an encoder written another way, hardware recordings and can-utils."""

import random

import pytest

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.errors import FrameError
from canarm_protocol.transport.bits import (
    INTERMISSION_BITS,
    arbitration_bits,
    arbitration_key,
    crc15,
    frame_bits,
    identifier,
    stuff,
    wire_bits,
    worst_case_bits,
)

GENERATOR = "1100010110011001"
"""x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1 with its leading term (CAN 2.0, 3.1.1)."""


def divide(text: str) -> str:
    """CRC sequence as CAN 2.0, 3.1.1 puts it: the remainder of the bits and fifteen zeros, by long division."""
    bits = list(text + "0" * 15)
    for place in range(len(text)):
        if bits[place] == "1":
            for offset, term in enumerate(GENERATOR):
                bits[place + offset] = "1" if bits[place + offset] != term else "0"
    return "".join(bits[-15:])


def encode(frame: Frame) -> str:
    """A frame written out field by field, stuffed by searching for five equal characters."""
    identifier_text = f"{frame.can_id:0{29 if frame.is_extended else 11}b}"
    remote = "1" if frame.is_remote else "0"
    if frame.is_extended:
        head = "0" + identifier_text[:11] + "11" + identifier_text[11:] + remote + "00"
    else:
        head = "0" + identifier_text + remote + "00"
    body = head + f"{len(frame.data):04b}" + ("" if frame.is_remote else "".join(f"{byte:08b}" for byte in frame.data))
    rest, sent = body + divide(body), ""
    while rest:
        sent, rest = sent + rest[0], rest[1:]
        tail = sent[-5:]
        if tail == "00000":
            sent, rest = sent, "1" + rest
            sent, rest = sent + rest[0], rest[1:]
        elif tail == "11111":
            sent = sent + "0"
    return sent + "1" + "1" + "1" + "1111111"


def random_frame(source: random.Random) -> Frame:
    is_extended = source.random() < 0.5
    is_remote = source.random() < 0.1
    runs = source.choice((bytes(range(256)), b"\x00\xff\x0f\xf0\xc1\x83\x1f\xe0"))
    data = bytes(source.choice(runs) for _ in range(source.randrange(9)))
    can_id = source.getrandbits(29 if is_extended else 11)
    return Frame(can_id & source.choice((can_id, 0x1FFFFFFF, 0xF0F)), data, is_extended, is_remote)


def test_a_thousand_frames_have_the_bits_of_an_encoder_written_another_way() -> None:
    source = random.Random(11898)
    for _ in range(1000):
        frame = random_frame(source)
        expected = encode(frame)
        assert wire_bits(frame) == expected, frame
        assert frame_bits(frame) == len(expected), frame


def test_crc_check_value_is_that_of_the_catalogue() -> None:
    """CRC-15/CAN in G. Cook's catalogue of parametrised CRC algorithms: check 0x059e."""
    assert crc15(b"123456789") == 0x059E


@pytest.mark.parametrize(
    ("can_id", "data", "bit_count"),
    [
        (0x18EBFF00, "01 A0 0F A6 60 3B D1 40", 141),
        (0x18EBFF00, "02 1F DE 80 25 DF C0 2B", 140),
        (0x18EBFF00, "03 E1 00 4B FF FF 3C 0F", 146),
        (0x18EBFF00, "04 00 4B FF FF FF FF FF", 146),
        (0x6F8, "FF 00 0C FE 00 00 00 00", 124),
    ],
)
def test_lengths_are_those_that_recording_hardware_counted(can_id: int, data: str, bit_count: int) -> None:
    """BitCount, intermission included, in a CANoe recording (python-can, test/data/logfile.asc).

    Its sixth frame, 6F9, counts 124; this encoder, the one above and can-utils all say 123.
    """
    frame = Frame(can_id, bytes.fromhex(data), can_id > 0x7FF)
    assert frame_bits(frame) + INTERMISSION_BITS == bit_count


@pytest.mark.parametrize(
    ("frame", "length"),
    [
        (Frame(0x000, bytes(8)), 127),
        (Frame(0x7FF, b"\xff" * 8), 126),
        (Frame(0x078, b"\x3c" * 8), 131),
        (Frame(0x294, bytes.fromhex("803f8013003a8000")), 123),
        (Frame(0x213, b"\x05"), 57),
        (Frame(0x080), 51),
        (Frame(0x1FFFFFFF, bytes(8), True), 151),
        (Frame(0x00000000, b"\xff" * 8, True), 150),
        (Frame(0x12345678, bytes.fromhex("deadbeef"), True), 101),
    ],
)
def test_lengths_are_those_of_can_utils(frame: Frame, length: int) -> None:
    """can_frame_length(..., CFL_EXACT) of can-utils 95aae6b, intermission included."""
    assert frame_bits(frame) + INTERMISSION_BITS == length


def test_a_remote_frame_carries_a_length_and_no_data() -> None:
    assert frame_bits(Frame(0x123, bytes(8), is_remote=True)) < 60
    assert wire_bits(Frame(0x123, b"\xff", is_remote=True)) == encode(Frame(0x123, b"\x00", is_remote=True))


@pytest.mark.parametrize("is_extended", [False, True])
@pytest.mark.parametrize("size", range(9))
def test_no_frame_is_longer_than_the_worst_case(size: int, is_extended: bool) -> None:
    source = random.Random(size)
    bound = worst_case_bits(size, is_extended)
    for _ in range(300):
        data = bytes(source.choice(b"\x3c\xc3\x0f\xf0\x87\x78\x1e\xe1\x00\xff") for _ in range(size))
        can_id = (
            source.choice((0x078, 0x07F, 0x3C3, 0x1E1)) << 18 * is_extended | source.choice((0, 0x3C3C)) * is_extended
        )
        assert frame_bits(Frame(can_id, data, is_extended)) <= bound


@pytest.mark.parametrize(
    ("is_extended", "size", "bits"), [(False, 8, 135), (False, 0, 55), (True, 8, 160), (True, 0, 80)]
)
def test_worst_case_is_that_of_the_analysis(is_extended: bool, size: int, bits: int) -> None:
    """Davis et al. 2007, equations 1 and 2: C = (55 + 10 s) bits with 11-bit identifiers, (80 + 10 s) with 29."""
    assert worst_case_bits(size, is_extended) + INTERMISSION_BITS == bits


@pytest.mark.parametrize("exposed", [34, 34 + 64, 54, 54 + 64])
def test_the_stuffing_rule_attains_the_worst_case(exposed: int) -> None:
    pattern = ("00000" + "11110000" * 20)[:exposed]
    assert len(stuff(pattern)) - exposed == (exposed - 1) // 4


def test_the_longest_frame_without_data_is_two_bits_below_the_bound() -> None:
    """All 2048 of them, by the independent encoder: IDE, r0 and DLC break the worst pattern."""
    assert max(len(encode(Frame(can_id))) for can_id in range(2048)) == worst_case_bits(0) - 2
    assert max(frame_bits(Frame(can_id)) for can_id in range(2048)) == worst_case_bits(0) - 2


def test_arbitration_goes_by_the_bits_as_sent() -> None:
    """The lower key is the frame that first sends a dominant bit where the other sends a recessive one."""
    source = random.Random(4)
    for _ in range(500):
        one, other = random_frame(source), random_frame(source)
        if source.random() < 0.5:
            other = other._replace(
                can_id=one.can_id >> 18 if one.is_extended and not other.is_extended else other.can_id
            )
        if arbitration_key(one) == arbitration_key(other):
            continue
        first_differing = next((a, b) for a, b in zip(encode(one), encode(other), strict=False) if a != b)
        assert (first_differing[0] == "0") == (arbitration_key(one) < arbitration_key(other)), (one, other)


def test_one_base_identifier_goes_data_remote_extended() -> None:
    data, remote, extended = Frame(0x100), Frame(0x100, is_remote=True), Frame(0x100 << 18, is_extended=True)
    assert sorted((extended, remote, data), key=arbitration_key) == [data, remote, extended]


def test_an_arbitration_key_gives_the_identifier_back() -> None:
    source = random.Random(5)
    for _ in range(200):
        frame = random_frame(source)
        assert identifier(arbitration_key(frame)) == (frame.can_id, frame.is_extended)


def test_arbitration_ends_with_rtr() -> None:
    assert arbitration_bits(Frame(0x555)) == 13
    assert arbitration_bits(Frame(0x000)) == 13 + 2
    assert arbitration_bits(Frame(0x15555555, is_extended=True)) == 33


@pytest.mark.parametrize("frame", [Frame(0x800), Frame(-1), Frame(0x2000_0000, is_extended=True), Frame(1, bytes(9))])
def test_what_is_no_classical_frame_is_refused(frame: Frame) -> None:
    with pytest.raises(FrameError, match=r"does not fit|at most 8"):
        frame_bits(frame)
