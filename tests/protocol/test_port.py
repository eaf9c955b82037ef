"""Opening a bus by python-can's flags: the same promises on a `canarm` bus and on any other, one error class."""

import contextlib
import errno
import os
import socket
import threading
import time
import tty
import uuid
from collections.abc import Callable, Iterator

import can
import pytest
from can.interfaces.udp_multicast.utils import pack_message

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.errors import BusError
from canarm_protocol.transport import python_can_port
from canarm_protocol.transport.port import BusPort, Discarded, open_port, parse_bus_options

DEADLINE_S = 10.0


@pytest.fixture
def channel() -> str:
    return uuid.uuid4().hex[:12]


@pytest.fixture
def peer(channel: str) -> Iterator[can.BusABC]:
    with can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as peer:
        yield peer


@pytest.fixture
def port(channel: str) -> Iterator[BusPort]:
    with open_port("virtual", channel) as port:
        yield port


@pytest.fixture
def serve() -> Iterator[Callable[[], tuple[int, socket.socket]]]:
    """Call it in a thread of its own: a socketcand server for one client."""
    with contextlib.ExitStack() as stack:

        def start() -> tuple[BusPort, socket.socket]:
            listener = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            accepted: list[socket.socket] = []

            def shake_hands() -> None:
                connection, _ = listener.accept()
                connection.settimeout(DEADLINE_S)
                accepted.append(connection)
                for reply in (b"< hi >", b"< ok >", b"< ok >"):
                    connection.sendall(reply)
                    while connection.recv(1) not in (b">", b""):
                        pass

            thread = threading.Thread(target=shake_hands, daemon=True)
            thread.start()
            port = stack.enter_context(open_port("canarm", "bench", port=listener.getsockname()[1]))
            thread.join(DEADLINE_S)
            return port, stack.enter_context(accepted[0])

        yield start


def test_canarm_bus_carries_frames_both_ways(serve):
    port, connection = serve()
    number = connection.getsockname()[1]
    assert port.description == f"--bus-kwargs host=127.0.0.1 port={number} -i canarm -c bench"
    port.send([Frame(0x123, b"\x0a"), Frame(0x124)])
    assert connection.recv(256) == b"< send 123 1 0a >< send 124 0 >"
    connection.sendall(b"< error 004 1.0 >< frame 123 23.424242 1A220344 >")
    assert port.receive(DEADLINE_S) == [(23_424_242_000, Frame(0x123, b"\x1a\x22\x03\x44"))]
    assert port.discarded == Discarded(error_frames=1)
    assert port.fileno() >= 0


def test_losing_a_canarm_bus_is_a_bus_error_that_names_it(serve):
    port, connection = serve()
    connection.close()
    for call in (lambda: port.receive(DEADLINE_S), lambda: port.send([Frame(1)])):
        with pytest.raises(BusError, match=r"^--bus-kwargs \S+ port=\d+ -i canarm -c bench: the server closed"):
            call()


def test_a_remote_frame_on_a_canarm_bus_is_a_bus_error(serve):
    port, _ = serve()
    with pytest.raises(BusError, match="socketcand carries data frames"):
        port.send([Frame(1, is_remote=True)])


def test_any_python_can_bus_carries_frames_both_ways(port, peer, channel):
    assert port.description == f"-i virtual -c {channel}"
    port.send([Frame(0x123, b"\x0a"), Frame(0x1AAAAAAA, b"", is_extended=True), Frame(0x7, is_remote=True)])
    received = [peer.recv(DEADLINE_S) for _ in range(3)]
    assert [(message.arbitration_id, bytes(message.data)) for message in received[:2]] == [
        (0x123, b"\x0a"),
        (0x1AAAAAAA, b""),
    ]
    assert [message.is_extended_id for message in received] == [False, True, False]
    assert received[2].is_remote_frame


def test_everything_that_has_arrived_is_received_at_once_with_its_time(port, peer):
    # 1700000000.123457 s is beyond a float's nanoseconds; the microseconds have to survive.
    for step, can_id in enumerate((0x181, 0x281, 0x381)):
        stamp = 1_700_000_000.123457 + step
        peer.send(can.Message(timestamp=stamp, arbitration_id=can_id, data=b"\x01", is_extended_id=False))
    assert port.receive(DEADLINE_S) == [
        (1_700_000_000_123_457_000, Frame(0x181, b"\x01")),
        (1_700_000_001_123_457_000, Frame(0x281, b"\x01")),
        (1_700_000_002_123_457_000, Frame(0x381, b"\x01")),
    ]
    assert port.receive(0.0) == []


def test_remote_frames_pass_with_the_length_that_they_ask_for(port, peer):
    peer.send(can.Message(arbitration_id=0x701, is_remote_frame=True, dlc=1, is_extended_id=False, timestamp=1.0))
    assert port.receive(DEADLINE_S) == [(1_000_000_000, Frame(0x701, bytes(1), is_remote=True))]
    port.send([Frame(0x294, bytes(8), is_remote=True)])
    message = peer.recv(DEADLINE_S)
    assert (message.dlc, message.is_remote_frame) == (8, True)


class Stumbling:
    """A driver that raises what it is given, one after the other, and then has a frame."""

    def __init__(self, errors: list[Exception], descriptor: int | None = None) -> None:
        self._errors, self._descriptor = errors, descriptor
        self._frames = [can.Message(arbitration_id=1, is_extended_id=False, timestamp=1.0)]

    def recv(self, timeout: float | None) -> can.Message | None:
        if self._errors:
            raise self._errors.pop(0)
        return self._frames.pop() if self._frames else None

    def shutdown(self) -> None:
        pass

    def fileno(self) -> int:
        if self._descriptor is None:
            raise NotImplementedError
        return self._descriptor


def undecodable() -> can.CanOperationError:
    error = can.CanOperationError("could not unpack received message")  # udp_multicast, of an empty datagram
    error.__cause__ = ValueError("Unpack failed: incomplete input")
    return error


@pytest.mark.parametrize(
    "error",
    [
        undecodable(),
        ValueError("invalid literal for int()"),
        IndexError("string index"),
        UnicodeDecodeError("a", b"\xff", 0, 1, ""),
    ],
    ids=lambda error: type(error).__name__,
)
def test_what_a_driver_cannot_read_is_counted_and_is_no_lost_bus(port, error):
    port._bus = Stumbling([error, error])
    assert port.receive(0.0) == [(1_000_000_000, Frame(1))]
    assert port.discarded == Discarded(malformed=2)


def lost_line() -> can.CanOperationError:
    error = can.CanOperationError("Failed to wait for IP/UDP socket\nTraceback (most recent call last):\n  File x")
    error.__cause__ = OSError(errno.ENETDOWN, "Network is down")
    return error


def test_a_bus_that_is_lost_is_told_in_one_line_without_a_traceback(port):
    port._bus = Stumbling([lost_line()])
    with pytest.raises(BusError) as caught:
        port.receive(0.0)
    assert str(caught.value).endswith("lost: Failed to wait for IP/UDP socket")


def test_a_driver_that_never_reads_anything_again_is_a_lost_bus(port):
    port._bus = Stumbling([ValueError("x")] * 5000)
    with pytest.raises(BusError, match="lost: x"):  # noqa: PT012  which call it is does not matter
        for _ in range(10):
            port.receive(0.0)


@pytest.mark.parametrize(
    "line",
    [
        b"t1239112233445566778899",
        b"T1FFFFFFF9",
        b"r1239",
        b"tFFF0",
        b"t1",
        b"t12381122",
        b"r",
        b"\xff\xfe",
        b"t-123",
        b"TFFFFFFFF0",
    ],
)
@pytest.mark.skipif(os.name != "posix", reason="this system has no pseudo-terminals")
def test_what_a_serial_adapter_says_wrong_is_counted_and_the_next_frame_is_read(line):
    ours, theirs = os.openpty()
    try:
        tty.setraw(theirs)
        with open_port("slcan", os.ttyname(theirs), sleep_after_open=0) as port:
            os.write(ours, line + b"\rt08011A\r")
            frames: list[Frame] = []
            limit_s = time.monotonic() + DEADLINE_S
            while not frames and time.monotonic() < limit_s:
                frames += [frame for _, frame in port.receive(0.1)]
            assert frames == [Frame(0x080, b"\x1a")]
            assert port.discarded.malformed == 1
    finally:
        os.close(ours)
        os.close(theirs)


def multicast(**options: object) -> BusPort:
    try:
        return open_port("udp_multicast", "239.74.163.2", port=43_999, **options)
    except BusError as error:
        pytest.skip(f"no multicast here: {error}")


def test_a_stranger_on_the_network_reaches_no_multicast_bus_unless_that_is_meant(monkeypatch):
    """The sender's address is what tells a stranger: one that no socket of this machine can be bound to."""
    monkeypatch.setattr(python_can_port, "_is_own_address", lambda host, sender: False)
    message = can.Message(arbitration_id=0x213, is_extended_id=False, data=b"\x01")
    for options, expected in (({}, []), ({"allow_remote": True}, [0x213])):
        with (
            multicast(**options) as port,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
        ):
            stranger.sendto(b"", ("127.0.0.1", 43_999))
            stranger.sendto(pack_message(message), ("127.0.0.1", 43_999))
            frames = [frame for _ in range(3) for _, frame in port.receive(0.2)]
            assert [frame.can_id for frame in frames] == expected
            assert (port.discarded.foreign, port.discarded.malformed) == ((2, 0) if not options else (0, 1))


def test_own_addresses_are_told_from_others():
    assert python_can_port._is_own_address("127.0.0.1", ("127.0.0.1", 1))
    assert python_can_port._is_own_address("::1", ("::1", 1, 0, 0))
    assert not python_can_port._is_own_address("192.0.2.1", ("192.0.2.1", 1))  # RFC 5737: nobody's


def test_error_frames_are_counted_and_left_out(port, peer):
    peer.send(can.Message(is_error_frame=True))
    peer.send(can.Message(arbitration_id=2, is_extended_id=False, timestamp=3.0))
    assert port.receive(DEADLINE_S) == [(3_000_000_000, Frame(2))]
    assert port.discarded == Discarded(error_frames=1)


def test_a_frame_that_the_driver_marks_as_sent_here_is_passed_on(port, peer):
    """SocketCAN does so with the frames of every program on this host (MSG_DONTROUTE, raw(7) of Linux's can.rst)."""
    peer.send(can.Message(arbitration_id=2, is_extended_id=False, timestamp=3.0, is_rx=False))
    assert port.receive(DEADLINE_S) == [(3_000_000_000, Frame(2))]


def test_own_frames_cannot_be_asked_for(channel):
    with pytest.raises(BusError, match="leave receive_own_messages out"):
        open_port("virtual", channel, receive_own_messages=True)


def test_fd_frames_are_counted_and_left_out(channel):
    with (
        can.Bus(interface="virtual", channel=channel, protocol=can.CanProtocol.CAN_FD) as peer,
        open_port("virtual", channel, protocol=can.CanProtocol.CAN_FD) as port,
    ):
        peer.send(can.Message(is_fd=True, data=bytes(12)))
        assert port.receive(0.0) == []
        assert port.discarded == Discarded(fd_frames=1)


def test_a_bus_without_descriptor_says_none(port):
    assert port.fileno() is None


def test_losing_any_python_can_bus_is_a_bus_error(channel):
    port = open_port("virtual", channel)
    port.close()
    with pytest.raises(BusError, match=f"^-i virtual -c {channel}: cannot send: "):
        port.send([Frame(1)])
    with pytest.raises(BusError, match=f"^-i virtual -c {channel}: lost: "):
        port.receive(0.0)


def test_unknown_interface_lists_the_known_ones():
    with pytest.raises(BusError, match=r"^-i vcan -c can0: python-can knows no such interface; it knows .*socketcan"):
        open_port("vcan", "can0")


def test_missing_driver_library_is_a_bus_error(monkeypatch):
    monkeypatch.setitem(can.interfaces.BACKENDS, "cantact", ("a_driver_nobody_has", "Bus"))
    with pytest.raises(BusError, match=r"^-i cantact -c 0: its driver cannot be loaded: .*a_driver_nobody_has"):
        open_port("cantact", "0")


@pytest.mark.parametrize(
    ("interface", "channel", "options", "message"),
    [
        ("socketcand", "can0", {}, "-i socketcand -c can0: wrong or missing options: .*'host' and 'port'"),
        ("slcan", "/dev/no-such-adapter", {}, "-i slcan -c /dev/no-such-adapter: .*could not open port"),
        ("canarm", "can0", {"port": "x"}, "--bus-kwargs port=x -i canarm -c can0: "),
        ("canarm", "can0", {"port": 0}, r"--bus-kwargs \S+ port=0 -i canarm -c can0: a port is a number from 1"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_a_bus_error_with_its_flags(interface, channel, options, message):
    with pytest.raises(BusError, match=f"^{message}"):
        open_port(interface, channel, **options)


def test_options_get_the_types_that_python_can_gives_them():
    words = ["host=127.0.0.1", "port=1234", "ratio=0.5", "tcp_tune=True", "serial-number=-7", "url=a=b", "empty="]
    assert parse_bus_options(words) == {
        "host": "127.0.0.1",
        "port": 1234,
        "ratio": 0.5,
        "tcp_tune": True,
        "serial_number": -7,
        "url": "a=b",
        "empty": "",
    }


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["port"], "write KEY=VALUE"),
        (["=1"], "write KEY=VALUE"),
        (["a b=1"], "write KEY=VALUE"),
        (["port=1", "port=2"], "given twice"),
        (["channel=can0"], "write -c can0"),
        (["interface=slcan"], "write -i slcan"),
        (["port=" + "9" * 5000], "port: a number of 5000 digits"),
    ],
)
def test_wrong_options_say_what_would_be_right(words, message):
    with pytest.raises(BusError, match=message):
        parse_bus_options(words)


@pytest.mark.skipif(os.name != "posix", reason="this system has no pseudo-terminals")
def test_acknowledgements_of_a_serial_adapter_hide_no_frames():
    ours, theirs = os.openpty()
    try:
        with open_port("slcan", os.ttyname(theirs), sleep_after_open=0) as port:
            os.write(ours, b"\rz\rt08011A\rz\rZ\rt0810\r\a")
            assert [frame for _, frame in port.receive(DEADLINE_S)] == [Frame(0x080, b"\x1a"), Frame(0x081)]
            assert port.receive(0.0) == []
            port.send([Frame(0x123, b"\xab")])
            written = b""
            while written.count(b"\r") < 2:
                written += os.read(ours, 256)
            assert written == b"O\rt1231AB\r"
    finally:
        os.close(ours)
        os.close(theirs)
