"""Frames of CiA 301 against the bytes in the standard."""

import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm_protocol.canopen.frames import (
    Cob,
    Emergency,
    ErrorCode,
    Frame,
    NmtCommand,
    NmtState,
    heartbeat_frame,
    nmt_frame,
    parse_nmt,
    parse_time,
    sync_frame,
    time_frame,
)
from canarm_protocol.errors import FrameError

MILLISECOND = 1_000_000
LAST_DAY = 0xFFFF


def test_nmt_start_of_node_0x12_and_of_all() -> None:
    assert nmt_frame(NmtCommand.START, 0x12) == Frame(0x000, b"\x01\x12")
    assert nmt_frame(NmtCommand.RESET_NODE) == Frame(0x000, b"\x81\x00")


@pytest.mark.parametrize("command", list(NmtCommand))
def test_nmt_commands_are_read_back(command: NmtCommand) -> None:
    assert parse_nmt(nmt_frame(command, 5).data) == (command, 5)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "NMT command with 0 bytes; CiA 301 says 2"),
        (b"\x01", "NMT command with 1 bytes; CiA 301 says 2"),
        (b"\x01\x02\x03", "NMT command with 3 bytes; CiA 301 says 2"),
        (b"\x03\x00", "NMT command specifier 0x03 is not one of CiA 301's"),
    ],
)
def test_malformed_nmt_commands_say_what_is_wrong(data: bytes, message: str) -> None:
    with pytest.raises(FrameError) as caught:
        parse_nmt(data)
    assert str(caught.value) == message


def test_sync_has_one_byte_with_its_counter_and_none_without() -> None:
    assert sync_frame(240) == Frame(0x080, b"\xf0")
    assert sync_frame(None) == Frame(0x080, b"")


def test_heartbeat_and_boot_up_carry_the_state() -> None:
    assert heartbeat_frame(0x14, NmtState.PRE_OPERATIONAL) == Frame(0x714, b"\x7f")
    assert heartbeat_frame(0x14, NmtState.BOOT_UP) == Frame(0x714, b"\x00")


def test_emcy_of_a_lost_heartbeat_has_the_bytes_of_cia_301() -> None:
    emergency = Emergency(ErrorCode.LIFE_GUARD_OR_HEARTBEAT, 0x11)
    frame = emergency.frame(0x12)
    assert frame == Frame(0x092, bytes.fromhex("3081110000000000"))
    assert Emergency.parse(frame.data) == emergency


def test_emcy_of_another_length_is_refused() -> None:
    with pytest.raises(FrameError, match=r"^EMCY with 7 bytes; CiA 301 says 8$"):
        Emergency.parse(bytes(7))


def test_time_counts_milliseconds_of_the_day_and_days_since_1984() -> None:
    days = (datetime.date(2026, 3, 1) - datetime.date(1984, 1, 1)).days
    frame = time_frame((days * 86_400 + 45_000) * 10**9 + 250 * MILLISECOND)
    assert frame.can_id == Cob.TIME == 0x100
    assert frame.data == (45_000_250).to_bytes(4, "little") + days.to_bytes(2, "little")


@given(day=st.integers(0, LAST_DAY), of_day_ms=st.integers(0, 86_399_999), rest_ns=st.integers(0, MILLISECOND - 1))
def test_time_is_read_back_to_the_millisecond(day: int, of_day_ms: int, rest_ns: int) -> None:
    time_ns = day * 86_400_000 * MILLISECOND + of_day_ms * MILLISECOND
    assert parse_time(time_frame(time_ns + rest_ns).data) == time_ns


def test_the_reserved_bits_of_time_are_left_aside() -> None:
    assert parse_time(b"\x01\x00\x00\xf0\x00\x00") == MILLISECOND


def test_time_of_another_length_is_refused() -> None:
    with pytest.raises(FrameError, match=r"^TIME with 4 bytes; CiA 301 says 6$"):
        parse_time(bytes(4))
