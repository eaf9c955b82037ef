"""The python-can bus on TCP, against a scripted server that says the bytes of socketcand's protocol document."""

import asyncio
import contextlib
import select
import socket
import threading
import time
from collections.abc import Iterator

import can
import pytest

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.transport.hub_client import HubClientBus

DEADLINE_S = 10.0


class ScriptedServer:
    """Accepts one client, makes the handshake in a thread, then leaves the connection to the test."""

    def __init__(self, replies: tuple[bytes, ...] = (b"< hi >", b"< ok >", b"< ok >")) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.replies = replies
        self.connection: socket.socket | None = None
        self.requests = b""
        self.thread = threading.Thread(target=self._shake_hands, daemon=True)
        self.thread.start()

    def _shake_hands(self) -> None:
        # A test that does not connect closes the listener.
        with contextlib.suppress(OSError):
            self.connection, _ = self.listener.accept()
            self.connection.settimeout(DEADLINE_S)
            for reply in self.replies:
                self.connection.sendall(reply)
                self.requests += self._hear_element()

    def _hear_element(self) -> bytes:
        element = b""
        while not element.endswith(b">") and (byte := self.connection.recv(1)):
            element += byte
        return element

    def say(self, data: bytes) -> None:
        self.thread.join(DEADLINE_S)
        self.connection.sendall(data)

    def hear(self, size: int) -> bytes:
        self.thread.join(DEADLINE_S)
        heard = b""
        while len(heard) < size:
            heard += self.connection.recv(size - len(heard))
        return heard

    def hang_up(self) -> None:
        self.thread.join(DEADLINE_S)
        self.connection.close()

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        self.thread.join(DEADLINE_S)
        if self.connection is not None:
            self.connection.close()


@pytest.fixture
def server() -> Iterator[ScriptedServer]:
    server = ScriptedServer()
    yield server
    server.close()


@pytest.fixture
def bus(server: ScriptedServer) -> Iterator[HubClientBus]:
    with can.Bus(interface="canarm", channel="can0", port=server.port) as bus:
        yield bus


def receive(bus: HubClientBus, count: int) -> list[tuple[int, Frame]]:
    """`count` frames, however many reads they take."""
    deadline_s = time.monotonic() + DEADLINE_S
    frames: list[tuple[int, Frame]] = []
    while len(frames) < count and time.monotonic() < deadline_s:
        frames += bus.receive_frames(0.1)
    return frames


def test_handshake_opens_the_channel_and_ends_with_an_echo(server, bus):
    server.thread.join(DEADLINE_S)
    assert server.requests == b"< open can0 >< rawmode >< echo >"


def test_frames_that_come_with_the_end_of_the_handshake_are_not_lost():
    server = ScriptedServer((b"< hi >", b"< ok >", b"< ok >< frame 123 1.000000 11 >"))
    with HubClientBus("can0", port=server.port) as bus:
        assert select.select([bus], [], [], DEADLINE_S)[0] == [bus]
        assert receive(bus, 1) == [(1_000_000_000, Frame(0x123, b"\x11"))]
    server.close()


def test_frames_are_received_with_their_time_and_the_echo_is_swallowed(server, bus):
    server.say(b"< echo >< frame 123 23.424242 1A220344 >< frame 080 23.424243  >< frame 1AAAAAAA 24.000000 FF >")
    assert receive(bus, 3) == [
        (23_424_242_000, Frame(0x123, b"\x1a\x22\x03\x44")),
        (23_424_243_000, Frame(0x080)),
        (24_000_000_000, Frame(0x1AAAAAAA, b"\xff", is_extended=True)),
    ]


def test_nothing_to_receive_is_an_empty_list(bus):
    assert bus.receive_frames(0.0) == []
    assert bus.recv(0.0) is None


def test_frames_are_sent_in_one_piece_and_in_order(server, bus):
    bus.send_frames([Frame(0x123), Frame(0x1AAAAAAA, b"\x01\xf1", is_extended=True)])
    expected = b"< send 123 0 >< send 1AAAAAAA 2 01 f1 >"
    assert server.hear(len(expected)) == expected


def test_python_can_messages_pass_both_ways(server, bus):
    bus.send(can.Message(arbitration_id=0x123, data=b"\x0a", is_extended_id=False))
    assert server.hear(17) == b"< send 123 1 0a >"
    server.say(b"< frame 123 1.500000 11 >< error 004 2.000000 >")
    message, error = bus.recv(DEADLINE_S), bus.recv(DEADLINE_S)
    assert (message.arbitration_id, bytes(message.data), message.timestamp) == (0x123, b"\x11", 1.5)
    assert (message.channel, message.is_rx, message.is_extended_id) == ("can0", True, False)
    assert (error.is_error_frame, error.arbitration_id, error.timestamp) == (True, 0x004, 2.0)


def test_error_frames_are_counted_when_only_frames_are_asked_for(server, bus):
    server.say(b"< error 004 1.000000 >< frame 123 1.000000 11 >")
    assert receive(bus, 1) == [(1_000_000_000, Frame(0x123, b"\x11"))]
    assert bus.error_frames == 1


@pytest.mark.parametrize(
    "message",
    [
        can.Message(arbitration_id=1, is_remote_frame=True, is_extended_id=False),
        can.Message(is_error_frame=True),
        can.Message(is_fd=True, data=bytes(12)),
    ],
    ids=["remote", "error", "fd"],
)
def test_what_socketcand_cannot_carry_is_counted_and_ends_no_player_or_bridge(server, bus, message, caplog):
    bus.send(message)
    bus.send(message)
    bus.send(can.Message(arbitration_id=0x123, is_extended_id=False))
    assert server.hear(len(b"< send 123 0 >")) == b"< send 123 0 >"
    assert bus.unsent == 2
    assert caplog.text.count("classical data frames only") == 1
    with pytest.raises(can.CanOperationError, match="data frames"):
        bus.send_frames([Frame(1, is_remote=True)])


def test_descriptor_stays_readable_until_every_message_of_a_read_is_taken(server, bus):
    server.say(b"".join(b"< frame %03X 1.000000  >" % can_id for can_id in range(5)))
    for can_id in range(5):
        assert select.select([bus], [], [], DEADLINE_S)[0] == [bus]
        assert bus.recv(DEADLINE_S).arbitration_id == can_id
    assert select.select([bus], [], [], 0)[0] == []


def test_messages_left_by_recv_come_first_in_receive_frames(server, bus):
    server.say(b"< frame 001 1.000000  >< frame 002 1.000001 22 >")
    assert bus.recv(DEADLINE_S).arbitration_id == 1
    server.say(b"< frame 003 1.000002 33 >")
    assert receive(bus, 2) == [(1_000_001_000, Frame(2, b"\x22")), (1_000_002_000, Frame(3, b"\x33"))]


def test_notifier_in_an_event_loop_hands_out_every_message(server, bus):
    async def collect() -> list[int]:
        reader = can.AsyncBufferedReader()
        notifier = can.Notifier(bus, [reader], loop=asyncio.get_running_loop())
        server.say(b"".join(b"< frame %03X 1.000000 11 >" % can_id for can_id in range(20)))
        try:
            return [(await asyncio.wait_for(reader.get_message(), DEADLINE_S)).arbitration_id for _ in range(20)]
        finally:
            notifier.stop()

    assert asyncio.run(collect()) == list(range(20))


def test_end_of_file_is_an_error_after_the_last_frame_and_stays_one(server, bus):
    server.say(b"< frame 001 1.000000  >")
    server.hang_up()
    assert receive(bus, 1) == [(1_000_000_000, Frame(1))]
    for call in (lambda: bus.receive_frames(DEADLINE_S), lambda: bus.recv(DEADLINE_S), lambda: bus.send_frames([])):
        with pytest.raises(can.CanOperationError, match="closed the connection"):
            call()


def test_a_server_that_reads_nothing_cannot_hold_a_sender(server):
    bus = HubClientBus("can0", port=server.port, send_timeout=0.05)
    more_than_the_kernel_buffers = [Frame(0x123, bytes(8))] * 1_000_000
    with pytest.raises(can.CanError, match="took no frames"):
        bus.send_frames(more_than_the_kernel_buffers)
    bus.shutdown()


def test_threads_do_not_mix_their_frames(server, bus):
    def send(can_id: int) -> None:
        for _ in range(200):
            bus.send_frames([Frame(can_id, bytes([can_id] * 8))] * 2)

    threads = [threading.Thread(target=send, args=(can_id,)) for can_id in range(0x10, 0x14)]
    for thread in threads:
        thread.start()
    pair = b"< send 010 8 10 10 10 10 10 10 10 10 >" * 2
    heard = server.hear(len(pair) * 4 * 200)
    for thread in threads:
        thread.join()
    pairs = {heard[start : start + len(pair)] for start in range(0, len(heard), len(pair))}
    assert pairs == {pair.replace(b"10", b"%x" % can_id) for can_id in range(0x10, 0x14)}


def test_shutdown_wakes_a_waiting_receiver(server):
    bus = HubClientBus("can0", port=server.port)
    errors: list[can.CanError] = []

    def wait() -> None:
        with contextlib.suppress(can.CanOperationError):
            bus.recv(None)
            return
        errors.append(can.CanOperationError())

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    bus.shutdown()
    thread.join(DEADLINE_S)
    assert not thread.is_alive()
    assert len(errors) == 1
    bus.shutdown()


def test_nobody_listening_is_said_at_once():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(can.CanInitializationError) as caught:
        can.Bus(interface="canarm", channel="can0", host="127.0.0.1", port=port)
    flags = f"--bus-kwargs host=127.0.0.1 port={port} -i canarm -c can0"
    assert str(caught.value) == f"{flags}: nobody listens there; start one with: canarm emulator"


@pytest.mark.parametrize(
    ("replies", "reason"),
    [
        ((b"< hi >", b"< error could not open bus >"), "there is no channel can7"),
        ((b"SSH-2.0-OpenSSH_9.2\r\n" * 20,), "no socketcand server"),
        ((b"",), "no socketcand handshake within 0.2 s"),
        ((b"< hi >", b"< error unknown command >"), "was refused"),
    ],
)
def test_failed_handshake_says_why(replies, reason):
    server = ScriptedServer(replies)
    with pytest.raises(can.CanInitializationError, match=reason):
        HubClientBus("can7", port=server.port, connect_timeout=0.2)
    server.close()


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"channel": "a b"}, "name of 1 to 16"),
        ({"channel": "x" * 17}, "name of 1 to 16"),
        ({"port": 99999}, "1 to 65535"),
        ({"fd": True}, "classical CAN"),
        ({"receive_own_messages": True}, "leave receive_own_messages out"),
        ({"prot": 29536}, "no option 'prot'; did you mean port"),
        ({"zzz": 1}, "no option 'zzz'; there are host, port"),
    ],
)
def test_wrong_options_are_refused_before_connecting(options, reason):
    with pytest.raises(can.CanInitializationError, match=reason):
        HubClientBus(**options)


def test_options_of_a_wire_that_python_cans_tools_give_mean_nothing_here():
    server = ScriptedServer([b"< hi >", b"< ok >", b"< ok >"])
    options = {"bitrate": 1_000_000, "fd": False, "receive_own_messages": False, "tcp_tune": True}
    can.Bus(interface="canarm", channel="can0", port=server.port, ignore_config=True, **options).shutdown()
    server.close()
