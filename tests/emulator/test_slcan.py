"""The slcan adapter: lines as in LAWICEL's CAN232 manual, and python-can's stock driver on the other side."""

from unittest import mock

import pytest
from can.interfaces.slcan import slcanBus
from hypothesis import given
from hypothesis import strategies as st

from canarm_emulator.serving.slcan import MAX_LINE, SlcanAdapter
from canarm_protocol.canopen.frames import Frame


@pytest.fixture
def adapter() -> SlcanAdapter:
    adapter = SlcanAdapter()
    assert adapter.feed(b"O\r") == ([], b"\r")
    return adapter


class FakeSerial:
    """pyserial's end of a line: what the driver writes, and what it is to read."""

    def __init__(self) -> None:
        self.written = b""
        self.to_read = b""
        self.write_timeout = None

    @property
    def in_waiting(self) -> int:
        return len(self.to_read)

    def read(self, size: int) -> bytes:
        data, self.to_read = self.to_read[:size], self.to_read[size:]
        return data

    def write(self, data: bytes) -> None:
        self.written += data

    def flush(self) -> None:
        pass

    def close(self) -> None:
        pass


def stock_driver() -> tuple[slcanBus, FakeSerial]:
    """python-can's driver on a line of ours."""
    serial = FakeSerial()
    with mock.patch("serial.serial_for_url", return_value=serial):
        bus = slcanBus("/dev/ttyACM0", sleep_after_open=0)
    assert serial.written == b"O\r"
    return bus, serial


@pytest.mark.parametrize(
    ("line", "frame", "answer"),
    [  # the manual's own examples, pages 6 and 7, and the shortest and longest frames
        (b"t10021133\r", Frame(0x100, b"\x11\x33"), b"z\r"),
        (b"T0000010021133\r", Frame(0x100, b"\x11\x33", is_extended=True), b"Z\r"),
        (b"r1002\r", Frame(0x100, bytes(2), is_remote=True), b"z\r"),
        (b"R000001002\r", Frame(0x100, bytes(2), is_extended=True, is_remote=True), b"Z\r"),
        (b"t0800\r", Frame(0x080), b"z\r"),
        (b"T1fffffff8FfFfFfFfFfFfFfFf\r", Frame(0x1FFFFFFF, b"\xff" * 8, is_extended=True), b"Z\r"),
    ],
)
def test_a_frame_is_taken_and_acknowledged(adapter, line, frame, answer):
    assert adapter.feed(line) == ([frame], answer)


@pytest.mark.parametrize(
    ("frame", "line"),
    [
        (Frame(0x100, b"\x11\x33"), b"t10021133\r"),
        (Frame(0x100, b"\x11\x33", is_extended=True), b"T0000010021133\r"),
        (Frame(0x080), b"t0800\r"),
        (Frame(0x191, is_remote=True), b"r1910\r"),
        (Frame(0x191, bytes(8), is_remote=True), b"r1918\r"),
        (Frame(0x1ABCDEF0, is_extended=True, is_remote=True), b"R1ABCDEF00\r"),
    ],
)
def test_a_frame_of_the_bus_becomes_a_line(adapter, frame, line):
    assert adapter.line(frame, 0) == line


def test_time_stamps_are_milliseconds_within_a_minute(adapter):
    adapter.feed(b"Z1\r")
    assert adapter.line(Frame(0x100, b"\x01"), 59_999_999_999) == b"t100101EA5F\r"  # the manual's last one
    assert adapter.line(Frame(0x100, b"\x01"), 60_000_000_000) == b"t1001010000\r"
    adapter.feed(b"Z0\r")
    assert adapter.line(Frame(0x100, b"\x01"), 59_999_999_999) == b"t100101\r"


@pytest.mark.parametrize(
    "line",
    [
        b"t1002113",
        b"t1002113344",
        b"t10091122334455667788AA",
        b"t100",
        b"t8000",
        b"t+120",
        b"t1_20",
        b"t100211 3",
        b"T200000000",
        b"T123",
        b"r100211",
        b"t",
        b"d10021133",
        b"X0",
        b"P",
        b"Z2",
        b"Z",
        b"S6",
        b"V1",
        b"M123",
        b"hello",
        b"\xff\x00\x80",
        b" O",
    ],
)
def test_a_line_that_makes_no_sense_is_answered_with_bel_and_the_next_one_counts(adapter, line):
    assert adapter.feed(line + b"\rt0800\r") == ([Frame(0x080)], b"\az\r")
    assert adapter.refused == 1


def test_a_closed_adapter_takes_and_gives_no_frames():
    adapter = SlcanAdapter()
    assert adapter.feed(b"t0800\r") == ([], b"\a")
    assert adapter.line(Frame(0x080), 0) == b""
    adapter.feed(b"O\r")
    assert adapter.line(Frame(0x080), 0) == b"t0800\r"
    adapter.feed(b"C\r")
    assert adapter.line(Frame(0x080), 0) == b""


@pytest.mark.parametrize("command", [b"L\r", b"l\r"])
def test_one_who_only_listens_sends_nothing(command):
    adapter = SlcanAdapter()
    assert adapter.feed(command) == ([], b"\r")
    assert adapter.feed(b"t0800\r") == ([], b"\a")
    assert adapter.line(Frame(0x080), 0) == b"t0800\r"


def test_bit_rates_are_taken_while_closed_as_python_can_and_slcand_send_them():
    adapter = SlcanAdapter()
    assert adapter.feed(b"C\rS8\r\rO\rC\rs031C\rO\r") == ([], b"\r" * 7)
    assert adapter.feed(b"S8\rs031C\r") == ([], b"\a\a")
    adapter.feed(b"C\r")
    assert adapter.feed(b"S\rS10\rs031\rs031G\r") == ([], b"\a" * 4)


def test_questions_are_answered_and_filters_are_ignored(adapter):
    assert adapter.feed(b"V\rN\rF\r") == ([], b"V1013\rNCARM\rF00\r")
    assert adapter.feed(b"M00000000\rmFFFFFFFF\rW0\rX1\r") == ([], b"\r" * 4)
    assert adapter.line(Frame(0x7FF), 0) == b"t7FF0\r"


def test_lines_may_end_with_cr_lf_and_come_in_any_pieces(adapter):
    frames, answers = [], b""
    for byte in b"t10021133\r\nr1002\r\n":
        some_frames, some_answers = adapter.feed(bytes((byte,)))
        frames += some_frames
        answers += some_answers
    assert frames == [Frame(0x100, b"\x11\x33"), Frame(0x100, bytes(2), is_remote=True)]
    assert answers == b"z\rz\r"


def test_a_line_that_never_ends_is_one_refusal_and_then_forgotten(adapter):
    for _ in range(100):
        assert adapter.feed(b"t" * MAX_LINE) == ([], b"")
    assert adapter.feed(b"0800\rt0800\r") == ([Frame(0x080)], b"\az\r")
    assert adapter.refused == 1


def test_reset_forgets_half_a_line_and_closes(adapter):
    adapter.feed(b"Z1\rt08")
    adapter.reset()
    assert adapter.feed(b"O\r") == ([], b"\r")
    assert adapter.line(Frame(0x080), 10**9) == b"t0800\r"


@given(
    st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.booleans(), st.booleans(), st.sampled_from([b"Z0\r", b"Z1\r"])
)
def test_python_cans_driver_and_the_adapter_read_what_the_other_writes(number, data, is_extended, is_remote, stamps):
    length = len(data)
    frame = Frame(
        number if is_extended else number & 0x7FF, bytes(length) if is_remote else data, is_extended, is_remote
    )
    adapter = SlcanAdapter()
    adapter.feed(stamps + b"O\r")
    bus, serial = stock_driver()
    serial.to_read = adapter.line(frame, 12_345_000_000)
    message = bus.recv(0)
    assert message is not None
    assert (message.arbitration_id, message.is_extended_id, message.is_remote_frame) == (
        frame.can_id,
        is_extended,
        is_remote,
    )
    assert message.dlc == length  # which a remote frame asks for
    assert is_remote or bytes(message.data) == frame.data
    bus.send(message)
    bus.shutdown()
    assert adapter.feed(serial.written)[0] == [frame]
    assert not adapter.is_open


def test_python_can_reads_version_and_serial_number():
    adapter = SlcanAdapter()
    bus, serial = stock_driver()
    serial.to_read = adapter.feed(b"V\r")[1]
    assert bus.get_version(1.0) == (10, 13)
    serial.to_read = adapter.feed(b"N\r")[1]
    assert bus.get_serial_number(1.0) == "CARM"
    bus.shutdown()
