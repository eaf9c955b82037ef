"""The socketcand text, against the examples of its doc/protocol.md, state_raw.c, and python-can's own client."""

import itertools

import can
import pytest
from can.interfaces.socketcand.socketcand import (
    convert_ascii_message_to_can_message,
    convert_can_message_to_ascii_message,
)
from hypothesis import given
from hypothesis import strategies as st

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.errors import FrameError
from canarm_protocol.transport.socketcand import (
    MAX_ELEMENT,
    ClientParser,
    ErrorFrame,
    format_error,
    format_frame,
    format_send,
)
from canarm_protocol.transport.socketcand_server import (
    Bad,
    ChangeMode,
    Echo,
    Mode,
    Open,
    Send,
    ServerParser,
    Statistics,
    Subscribe,
    Unknown,
    Unsubscribe,
)

payloads = st.binary(max_size=8)
standard_frames = st.builds(lambda can_id, data: Frame(can_id, data), st.integers(0, 0x7FF), payloads)
extended_frames = st.builds(lambda can_id, data: Frame(can_id, data, True), st.integers(0, 0x1FFF_FFFF), payloads)
frames = standard_frames | extended_frames
times_us = st.integers(0, 10**16)
near_misses = st.text("<> framesdo\n\t.0123456789abcdefABCDEFx_-+ÿ\x85", max_size=200).map(
    lambda text: text.encode("latin-1")
)


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    """`data` cut at `cuts`, taken modulo its length."""
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[start:end] for start, end in itertools.pairwise(edges)]


def test_frame_element_is_that_of_the_protocol_document():
    assert format_frame(Frame(0x123, b"\x1a\x22\x03\x44"), 23_424_242_000) == b"< frame 123 23.424242 1A220344 >"


def test_empty_frame_has_two_blanks_because_python_can_needs_them():
    element = format_frame(Frame(0x80), 1_000_000_000)
    assert element == b"< frame 080 1.000000  >"
    assert convert_ascii_message_to_can_message(element.decode()).dlc == 0


def test_send_elements_are_those_of_the_protocol_document():
    assert format_send(Frame(0x123)) == b"< send 123 0 >"
    assert format_send(Frame(0x1AAAAAAA, b"\x01\xf1", is_extended=True)) == b"< send 1AAAAAAA 2 01 f1 >"


@pytest.mark.parametrize("write", [format_send, lambda frame: format_frame(frame, 0)])
def test_remote_frames_are_refused_because_the_protocol_has_none(write):
    with pytest.raises(FrameError, match="data frames"):
        write(Frame(0x123, is_remote=True))


def test_more_than_eight_bytes_are_not_sent():
    with pytest.raises(FrameError, match="9 bytes"):
        format_send(Frame(0x123, bytes(9)))


@given(st.lists(st.tuples(times_us, frames)), st.lists(st.integers(0), max_size=5))
def test_client_reads_back_every_frame_and_time_however_the_stream_is_cut(stamped, cuts):
    expected = [(time_us * 1000, frame) for time_us, frame in stamped]
    parser = ClientParser()
    stream = b"".join(format_frame(frame, time_ns) for time_ns, frame in expected)
    assert [item for piece in pieces(stream, cuts) for item in parser.feed(piece)] == expected
    assert parser.malformed == 0


@given(st.lists(frames), st.lists(st.integers(0), max_size=5))
def test_server_reads_back_every_send_however_the_stream_is_cut(sent, cuts):
    parser = ServerParser()
    stream = b"".join(map(format_send, sent))
    assert [item for piece in pieces(stream, cuts) for item in parser.feed(piece)] == [Send(frame) for frame in sent]


@given(frames, st.integers(0, 2**31 * 10**6))
def test_python_can_reads_our_frame_elements(frame, time_us):
    message = convert_ascii_message_to_can_message(format_frame(frame, time_us * 1000).decode())
    assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == frame[:3]
    assert round(message.timestamp * 1e6) == time_us


@given(frames)
def test_server_reads_what_python_can_sends(frame):
    message = can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=frame.is_extended)
    assert ServerParser().feed(convert_can_message_to_ascii_message(message).encode()) == [Send(frame)]


@given(st.binary(max_size=400) | near_misses)
def test_any_bytes_are_survived_and_the_next_frame_is_read(garbage):
    client, server = ClientParser(), ServerParser()
    client.feed(garbage)
    server.feed(garbage)
    assert client.feed(b">< frame 7FF 1.5 AB >")[-1:] == [(1_500_000_000, Frame(0x7FF, b"\xab"))]
    assert server.feed(b">< send 7FF 1 ab >")[-1:] == [Send(Frame(0x7FF, b"\xab"))]


@given(near_misses)
def test_the_fast_path_accepts_nothing_that_the_careful_path_refuses(middle):
    # A leading line feed sends the same text down the careful path.
    for fast, careful, head in (
        (ClientParser(), ClientParser(), b"< frame "),
        (ServerParser(), ServerParser(), b"< send "),
    ):
        text = head + middle + b" >"
        assert fast.feed(text) == careful.feed(b"\n" + text)


@pytest.mark.parametrize(
    "element",
    [
        b"< frame 123  11 >",
        b"< frame 0x1 1.0 11 >",
        b"< frame +12 1.0 11 >",
        b"< frame 1_2 1.0 11 >",
        b"< frame 800 1.0 11 >",
        b"< frame 123456789 1.0 11 >",
        b"< frame 123 1 11 >",
        b"< frame 123 1.0 1 >",
        b"< frame 123 1.0 112233445566778899 >",
        b"< frame 123 1" + b"0" * 400 + b".0 11 >",
        b"< frame >",
        b"< >",
    ],
)
def test_client_counts_a_malformed_frame_and_goes_on(element):
    parser = ClientParser()
    assert parser.feed(element + b"< frame 001 2.0 22 >") == [(2_000_000_000, Frame(1, b"\x22"))]
    assert parser.malformed == 1


@pytest.mark.parametrize(
    "element",
    [
        b"< send 123 2 11 >",
        b"< send 123 1 11 22 >",
        b"< send 123 9 1 2 3 4 5 6 7 8 9 >",
        b"< send 123 1 xx >",
        b"< send 1g3 1 11 >",
        b"< send 800 0 >",
        b"< send >",
        b"< send 12345 0 >",
        b"< send 123 0x1 1 >",
        b"< send 123 1 0x >",
        b"< send 123 1 1_0 >",
        b"< send 123 1 -1 >",
        b"< send 123 " + b"9" * 900 + b" 1 >",
        b"< open >",
        b"< subscribe 0 0 >",
        b"< subscribe 0 0 xyz >",
        b"< statistics often >",
        b"< statistics \xb2 >",
    ],
)
def test_server_answers_a_malformed_command_with_bad(element):
    parser = ServerParser()
    assert [type(command) for command in parser.feed(element + b"< echo >")] == [Bad, Echo]
    assert parser.malformed == 1


def test_commands_are_told_apart():
    text = b"< open can0 >< rawmode >\r\n< echo ><send 12 1 f>< add 1 0 123 0 >"
    assert ServerParser().feed(text) == [
        Open("can0"),
        ChangeMode(Mode.RAW),
        Echo(),
        Send(Frame(0x12, b"\x0f")),
        Unknown("add 1 0 123 0"),
    ]


@pytest.mark.parametrize(
    ("element", "frame"),
    [
        (b"< send 123 2 1 7f >", Frame(0x123, b"\x01\x7f")),
        (b"< send 0 2 ffffffffffffff81 0 >", Frame(0, b"\x81\x00")),
        (b"< send 612 8 40 0 10 0 ffffffffffffff80 0 0 0 >", Frame(0x612, bytes.fromhex("4000100080000000"))),
        (b"< send 9AAAAAAA 2 ffffff80 7f >", Frame(0x1AAAAAAA, b"\x80\x7f", True)),
        (b"< send ffffffff98ff1234 1 1 >", Frame(0x18FF1234, b"\x01", True)),
        (b"< send 80000123 0 >", Frame(0x123, b"", True)),
        (b"< send 0x213 2 0xff 1 >", Frame(0x213, b"\xff\x01")),
        (b"< send 213 02 ff 01 >", Frame(0x213, b"\xff\x01")),
        (b"< send 0000213 0000002 00000000000000ff 0X01 >", Frame(0x213, b"\xff\x01")),
        (b"< send 00000213 0 >", Frame(0x213, b"", True)),
    ],
)
def test_savvycan_sends_bytes_above_127_and_long_identifiers_and_whatever_scanf_reads(element, frame):
    # Qt 5 formats signed numbers as 64 bits (SavvyCAN); state_raw.c reads them with %x, %hhu and %hhx.
    assert ServerParser().feed(element) == [Send(frame)]


@pytest.mark.parametrize(
    ("element", "frame"),
    [
        (b"< send 40000123 2 11 22 >", Frame(0x123, bytes(2), True, True)),
        (b"< send C0000123 0 >", Frame(0x123, b"", True, True)),
        (b"< send 0x40000123 1 11 >", Frame(0x123, bytes(1), False, True)),
        (b"< sendrtr 123 8 >", Frame(0x123, bytes(8), False, True)),
        (b"< sendrtr 00000123 0 >", Frame(0x123, b"", True, True)),
    ],
)
def test_an_identifier_with_the_flag_of_a_remote_frame_is_one(element, frame):
    # state_raw.c writes the ID as it came into can_id, where linux/can.h has its flags; `sendrtr` sets bit 30 itself.
    assert ServerParser().feed(element) == [Send(frame)]


@pytest.mark.parametrize(
    "element", ["send 20000004 1 1", "send 60000123 0", "send e0000123 0", "send 0x20000123 1 1", "sendrtr 123 9"]
)
def test_an_identifier_with_the_flag_of_an_error_frame_is_no_data_and_counted(element):
    parser = ServerParser()
    assert parser.feed(f"< {element} >< send 123 1 7 >".encode()) == [Bad(element), Send(Frame(0x123, b"\x07"))]
    assert parser.malformed == 1


def test_kayak_subscribes_and_asks_for_statistics():
    # As BCMConnection.java and ControlConnection.java write it.
    text = b"< subscribe 0 0 294 >< unsubscribe 18ff1234 >< bcmmode >< controlmode >< statistics 1000 >"
    assert ServerParser().feed(text) == [
        Subscribe(0x294, False),
        Unsubscribe(0x18FF1234, True),
        ChangeMode(Mode.BCM),
        ChangeMode(Mode.CONTROL),
        Statistics(1000),
    ]


def test_error_frames_and_replies_are_laid_aside():
    parser = ClientParser()
    text = b"< ok >" + format_error(0x004, 12_345_678_000) + b"< frame 001 2.0  >< error unknown command >"
    assert text[6:31] == b"< error 004 12.345678 >< "
    assert parser.feed(text) == [(2_000_000_000, Frame(1))]
    assert list(parser.errors) == [ErrorFrame(12_345_678_000, 0x004)]
    assert list(parser.replies) == ["ok", "error unknown command"]


@pytest.mark.parametrize("parser", [ClientParser(), ServerParser()], ids=["client", "server"])
def test_a_line_that_never_ends_is_discarded_as_it_comes(parser):
    parser.feed(b"< frame ")
    for _ in range(100):
        assert parser.feed(b"1" * MAX_ELEMENT) == []
    assert parser.malformed >= 100  # so none of it was kept


def test_text_between_elements_is_counted_and_line_ends_are_not():
    parser = ServerParser()
    assert parser.feed(b"\r\n< echo >\r\njunk< echo >\r\n") == [Echo(), Echo()]
    assert (parser.malformed, parser.garbage_bytes) == (1, 6)
