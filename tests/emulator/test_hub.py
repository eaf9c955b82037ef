"""The virtual bus over real TCP: bytes as in socketcand's protocol document, python-can's stock client, and ours."""

import contextlib
import ipaddress
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator

import can
import pytest

from canarm_emulator.errors import EmulatorError
from canarm_emulator.serving.hub import MAX_CLIENTS, MAX_GARBAGE, TOO_MANY, Hub, HubError
from canarm_emulator.serving.hub_events import Attached, Detached, Event, Ready, Received, Unreadable
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.transport.hub_client import HubClientBus

DEADLINE_S = 10.0
ATTACH = b"< open can0 >< rawmode >< echo >"
ATTACHED = b"< hi >< ok >< ok >< echo >"


@pytest.fixture
def hub() -> Iterator[Hub]:
    hub = Hub(port=0)
    yield hub
    hub.close()


@pytest.fixture
def connect(hub: Hub) -> Iterator[Callable[..., socket.socket]]:
    """Connect, say something, and wait until the hub has answered with `answer`."""
    with contextlib.ExitStack() as stack:

        def connect(said: bytes = ATTACH, answer: bytes = ATTACHED) -> socket.socket:
            client = stack.enter_context(socket.create_connection(hub.address))
            client.setblocking(False)
            client.send(said)
            assert hear(hub, client, len(answer)) == answer
            return client

        yield connect


def poll_until(hub: Hub, happened: Callable[[list[Event]], bool]) -> list[Event]:
    """Poll until `happened`, given all events so far, or fail at a deadline."""
    deadline_s = time.monotonic() + DEADLINE_S
    events: list[Event] = []
    while not happened(events):
        assert time.monotonic() < deadline_s, f"did not happen; events so far: {events}"
        events += hub.poll(0.01)
    return events


def hear(hub: Hub, client: socket.socket, size: int) -> bytes:
    """`size` bytes from the hub, which is kept going meanwhile."""
    heard = b""

    def is_complete(_: list[Event]) -> bool:
        nonlocal heard
        with contextlib.suppress(BlockingIOError):
            heard += client.recv(size - len(heard))
        return len(heard) >= size

    poll_until(hub, is_complete)
    return heard


def is_closed(client: socket.socket) -> bool:
    try:
        while client.recv(1 << 16):
            pass
    except BlockingIOError:
        return False
    except ConnectionError:
        return True
    return True


@contextlib.contextmanager
def running(hub: Hub) -> Iterator[list[Event]]:
    """The hub in a thread that answers frame n with n + 1, stamped 1.5 s, and forwards n to the other clients."""
    events: list[Event] = []
    is_over = threading.Event()

    def run() -> None:
        while not is_over.is_set():
            for event in hub.poll(0.01):
                events.append(event)
                if isinstance(event, Received):
                    channel, client_id, frame = event
                    hub.send(channel, 1_000_000_000, frame, exclude=client_id)
                    hub.send(channel, 1_500_000_000, frame._replace(can_id=frame.can_id + 1))
            hub.flush()

    thread = threading.Thread(target=run)
    thread.start()
    yield events
    is_over.set()
    thread.join()


def test_handshake_and_events(hub, connect):
    client = connect(b"", b"< hi >")
    client.send(b"< open bench >")
    assert hear(hub, client, 6) == b"< ok >"
    client.send(b"< rawmode >")
    assert hear(hub, client, 6) == b"< ok >"
    client.send(b"< send 123 2 1 f1 >")
    assert poll_until(hub, bool) == [Received("bench", 1, Frame(0x123, b"\x01\xf1"))]
    client.close()
    assert poll_until(hub, bool) == [Detached("bench", 1)]
    assert hub.clients == ()


def test_opening_a_channel_is_reported_with_it(hub):
    with socket.create_connection(hub.address) as client:
        client.send(b"< open can0 >")
        assert poll_until(hub, bool) == [Attached("can0", 1)]
        assert [(info.channel, info.is_receiving) for info in hub.clients] == [("can0", False)]


def test_unknown_channel_is_an_error_and_the_end(hub, connect):
    client = connect(b"< open can7 >", b"< hi >< error could not open bus >")
    poll_until(hub, lambda _: is_closed(client))
    assert hub.clients == ()


def test_unknown_command_is_an_error_and_a_bad_send_is_ignored(hub, connect):
    client = connect()
    client.send(b"< isotpmode >< send 123 8 1 >< send 123 0 >< send 123 8 2 >")
    events = poll_until(hub, bool)
    assert events == [Unreadable("can0", 1, "send 123 8 1"), Received("can0", 1, Frame(0x123))]
    assert hear(hub, client, 25) == b"< error unknown command >"
    assert hub.clients[0].malformed == 2
    client.close()
    poll_until(hub, bool)
    assert hub.malformed == 2


def test_a_client_that_sends_before_it_has_opened_a_bus_is_told_so(hub, connect):
    client = connect(b"< send 123 0 >< open can0 >< send 124 0 >", b"< hi >< error unknown command >< ok >")
    assert hub.poll(0) == []
    client.send(b"< echo >")
    assert hear(hub, client, 8) == b"< echo >"
    assert hub.attached_to("can0") == 1


KAYAK = b"< open can0 >< subscribe 0 0 294 >< subscribe 0 0 18ff1234 >< echo >"


def test_kayak_gets_the_frames_that_it_has_subscribed_to_and_no_others(hub, connect):
    client = connect(KAYAK, b"< hi >< ok >< echo >")
    for frame in (Frame(0x294, b"\x01"), Frame(0x394), Frame(0x18FF1234, b"", True), Frame(0x294, b"", True)):
        hub.send("can0", 0, frame)
    client.send(b"< unsubscribe 294 >< echo >")
    heard = b"< frame 294 0.000000 01 >< frame 18FF1234 0.000000  >< echo >"
    assert hear(hub, client, len(heard)) == heard
    hub.send("can0", 0, Frame(0x294))
    hub.send("bench", 0, Frame(0x18FF1234, b"", True))
    client.send(b"< rawmode >< echo >")
    assert hear(hub, client, 14) == b"< ok >< echo >"
    hub.send("can0", 0, Frame(0x394))
    client.send(b"< bcmmode >< echo >")
    heard = b"< frame 394 0.000000  >< ok >< echo >"
    assert hear(hub, client, len(heard)) == heard
    hub.send("can0", 0, Frame(0x18FF1234, b"", True))  # subscriptions end with the mode
    client.send(b"< echo >")
    assert hear(hub, client, 8) == b"< echo >"


def test_kayak_gets_statistics_of_its_bus_as_often_as_it_wants(hub, connect):
    sender = connect()
    sender.send(b"< send 213 2 1 2 >")
    assert poll_until(hub, bool)
    client = connect(b"< open can0 >< controlmode >< statistics 10 >", b"< hi >< ok >< ok >")
    hub.send("can0", 0, Frame(0x213, b"\x01\x02"))
    hub.send("can0", 0, Frame(0x394, bytes(8)))
    element = b"< stat 10 2 2 1 >"
    assert hear(hub, client, 2 * len(element)) == 2 * element


def test_virtual_time_order_and_every_kind_of_frame_reach_the_client(hub, connect):
    client = connect()
    hub.send("can0", 2_500_000, Frame(0x080))
    hub.send("can0", 2_600_999, Frame(0x191, b"\x00\x7f\x80\xff"))
    hub.send("can0", 3_600_000_000_001_000, Frame(0x1ABCDEF0, bytes(8), is_extended=True))
    hub.send("can0", 3_600_000_000_001_000, Frame(0x191, is_remote=True))  # the protocol has none
    hub.send_error("can0", 3_600_000_000_002_000, 0x004)
    expected = (
        b"< frame 080 0.002500  >< frame 191 0.002600 007F80FF >"
        b"< frame 1ABCDEF0 3600000.000001 0000000000000000 >< error 004 3600000.000002 >"
    )
    assert hear(hub, client, len(expected)) == expected


def test_frames_reach_the_clients_of_their_channel_but_not_the_excluded_one(hub, connect):
    first, second = connect(), connect()
    other = connect(ATTACH.replace(b"can0", b"bench"))
    element = b"< frame 001 1.000000 01 >"
    hub.send("can0", 10**9, Frame(1, b"\x01"), exclude=1)
    hub.send("can0", 10**9, Frame(1, b"\x01"), exclude=None)
    assert hear(hub, second, 2 * len(element)) == 2 * element
    assert hear(hub, first, len(element)) == element
    hub.poll(0)
    for client in (first, other):
        with pytest.raises(BlockingIOError):
            client.recv(1)


def test_nothing_is_forwarded_unless_the_runner_says_so(hub, connect):
    first, second = connect(), connect()
    first.send(b"< send 001 0 >")
    assert poll_until(hub, bool)[-1] == Received("can0", 1, Frame(1))
    hub.flush()
    with pytest.raises(BlockingIOError):
        second.recv(1)


def test_frames_wait_until_a_client_has_spoken_after_its_handshake(hub, connect, monkeypatch):
    monkeypatch.setattr("canarm_emulator.serving.connection.HOLD_S", 3600.0)
    client = connect(b"< open can0 >< rawmode >", b"< hi >< ok >< ok >")
    hub.send("can0", 10**9, Frame(1))
    hub.flush()
    with pytest.raises(BlockingIOError):
        client.recv(1)
    client.send(b"< send 002 0 >")
    assert hear(hub, client, 23) == b"< frame 001 1.000000  >"


def test_frames_wait_no_longer_than_the_pause_after_a_handshake(hub, connect):
    client = connect(b"< open can0 >< rawmode >", b"< hi >< ok >< ok >")
    hub.send("can0", 10**9, Frame(1, b"\x01"))
    assert hear(hub, client, 25) == b"< frame 001 1.000000 01 >"


def test_slow_reader_loses_the_newest_whole_frames_and_delays_nobody(connect, hub):
    slow, quick = connect(), connect()
    element = b"< frame 191 0.000000 %016X >"
    size, batch = len(element % 0), 1000
    number = 0
    while not hub.dropped:  # until the kernel's buffers, some MB, and the queue are full
        assert number < 1_000_000
        for following in range(number, number + batch):
            hub.send("can0", 0, Frame(0x191, following.to_bytes(8, "big")))
        number += batch
        hub.flush()
        assert hear(hub, quick, batch * size)[-size:] == element % (number - 1)
    assert hub.dropped.keys() == {1}
    dropped = hub.dropped[1]
    heard = hear(hub, slow, (number - dropped) * size)
    assert heard == b"".join(element % kept for kept in range(number - dropped))
    slow.close()
    poll_until(hub, bool)
    assert hub.dropped == {1: dropped}  # still known when the client is gone


def test_ten_megabytes_of_garbage_end_their_own_connection_only(hub, connect):
    good = connect()
    for garbage in (b"\x00\xff<>>" * 2000, b"<" + b"a" * 10_000):
        bad = connect()
        sent = 0
        events: list[Event] = []
        with contextlib.suppress(ConnectionError):
            while sent < 10_000_000:
                with contextlib.suppress(BlockingIOError):
                    sent += bad.send(garbage)
                events += hub.poll(0)
                if any(isinstance(event, Detached) for event in events):
                    break
        assert sent >= MAX_GARBAGE
        assert [type(event) for event in events if type(event) is not Unreadable] == [Detached]
    good.send(b"< echo >")
    assert hear(hub, good, 8) == b"< echo >"


def test_occasional_nonsense_does_not_end_a_connection(hub, connect):
    client = connect()
    for _ in range(40):
        client.send(b"nonsense " * 100 + b"< echo >")
        assert hear(hub, client, 8) == b"< echo >"
    assert hub.clients[0].malformed == 40


@pytest.mark.parametrize("said", [b"", b"<", b"< open can0 >< rawmode >< send 12"])
def test_silent_and_half_spoken_clients_may_vanish_at_any_time(hub, connect, said):
    good = connect()
    client = connect(said, b"< hi >")
    client.setsockopt(
        socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00"
    )  # reset, not end of file
    client.close()
    hub.send("can0", 10**9, Frame(1, b"\x01"))
    poll_until(hub, lambda _: len(hub.clients) == 1)
    assert hear(hub, good, 25) == b"< frame 001 1.000000 01 >"


def test_connections_that_never_open_a_channel_make_room_for_one_that_does(hub):
    with contextlib.ExitStack() as stack:
        first = stack.enter_context(socket.create_connection(hub.address))
        hub.poll(DEADLINE_S)
        for _ in range(MAX_CLIENTS):
            client = stack.enter_context(socket.create_connection(hub.address))
            hub.poll(DEADLINE_S)
        first.settimeout(DEADLINE_S)
        assert first.recv(100) == b"< hi >< error too many clients >"
        client.send(ATTACH)
        assert Attached("can0", MAX_CLIENTS + 1) in poll_until(hub, bool)
        assert len(hub.clients) == MAX_CLIENTS


def test_watched_files_are_reported_while_readable_and_once_when_closed(hub):
    left, right = socket.socketpair()
    hub.watch(left)
    assert hub.poll(0) == []
    right.send(b"x")
    assert hub.poll(DEADLINE_S) == [Ready(left)]
    hub.unwatch(left)
    assert hub.poll(0) == []
    hub.watch(left)
    left.close()
    right.close()
    assert hub.poll(0) == [Ready(left)]
    assert hub.poll(0) == []
    hub.unwatch(left)


def test_stock_python_can_client_works_as_it_is(hub):
    host, port = hub.address
    with running(hub), can.Bus(interface="socketcand", channel="can0", host=host, port=port) as bus:
        for number in range(50):
            for can_id in (0x10, 0x20):
                bus.send(can.Message(arbitration_id=can_id, data=[number, 0x80], is_extended_id=False))
            answers = [bus.recv(DEADLINE_S) for _ in range(2)]
            assert [answer.arbitration_id for answer in answers] == [0x11, 0x21]
            assert [bytes(answer.data) for answer in answers] == [bytes((number, 0x80))] * 2
            assert answers[0].timestamp == 1.5
        bus.send(can.Message(arbitration_id=0x1ABCDEF0))
        answer = bus.recv(DEADLINE_S)
        assert (answer.arbitration_id, answer.is_extended_id, answer.dlc) == (0x1ABCDEF1, True, 0)


def test_stock_client_survives_a_bus_that_is_busy_while_it_connects(hub):
    is_over = threading.Event()

    def chatter() -> None:
        while not is_over.is_set():
            hub.poll(0.001)
            hub.send("can0", 10**9, Frame(0x191, bytes(8)))
            hub.flush()

    thread = threading.Thread(target=chatter)
    thread.start()
    try:
        for _ in range(3):
            with can.Bus(interface="socketcand", channel="can0", host=hub.address[0], port=hub.address[1]) as bus:
                assert bus.recv(DEADLINE_S).arbitration_id == 0x191
    finally:
        is_over.set()
        thread.join()


def test_several_of_our_clients_see_each_other_through_the_runner(hub):
    host, port = hub.address
    with running(hub), HubClientBus("can0", host, port) as first, HubClientBus("can0", host, port) as second:
        first.send_frames([Frame(0x10, b"\x01"), Frame(0x20)])
        heard: list[tuple[int, Frame]] = []
        deadline_s = time.monotonic() + DEADLINE_S
        while len(heard) < 4 and time.monotonic() < deadline_s:
            heard += second.receive_frames(0.1)
        assert heard == [
            (1_000_000_000, Frame(0x10, b"\x01")),
            (1_500_000_000, Frame(0x11, b"\x01")),
            (1_000_000_000, Frame(0x20)),
            (1_500_000_000, Frame(0x21)),
        ]
        assert first.recv(DEADLINE_S).arbitration_id == 0x11


def test_our_client_hears_that_the_hub_was_closed(hub):
    with running(hub):
        bus = HubClientBus("can0", *hub.address)
    hub.close()
    hub.close()
    with pytest.raises(can.CanOperationError, match="was the emulator stopped"):
        bus.receive_frames(DEADLINE_S)
    bus.shutdown()


def test_port_in_use_is_one_clear_line(hub):
    host, port = hub.address
    with pytest.raises(HubError) as caught:
        Hub(host, port)
    expected = f"{host}:{port} is in use; stop the other emulator or choose another --serve HOST:PORT"
    assert str(caught.value) == expected
    assert isinstance(caught.value, EmulatorError)


@pytest.mark.parametrize("host", ["0.0.0.0", "", "::", "192.0.2.1"])
def test_an_address_that_others_can_reach_needs_to_be_meant(host):
    with pytest.raises(HubError, match=r"can be reached from the network.*--allow-remote"):
        Hub(host, 0)


def test_an_address_that_others_can_reach_is_served_when_meant():
    hub = Hub("0.0.0.0", 0, allow_remote=True)
    assert ipaddress.ip_address(hub.address[0]).is_unspecified
    hub.close()


@pytest.mark.parametrize(
    ("host", "port", "message"),
    [
        ("127.0.0.1", 65536, "a port is a number"),
        ("no.such.host.invalid", 0, "unknown host"),
        ("192.0.2.1", 0, "is no address of this machine"),  # TEST-NET-1, RFC 5737
    ],
)
def test_an_address_that_cannot_be_served_says_why(host, port, message):
    with pytest.raises(HubError, match=message):
        Hub(host, port, allow_remote=True)


def test_a_channel_that_is_not_served_is_refused(hub):
    with pytest.raises(HubError, match="'can7' is not served; served are can0, bench"):
        hub.send("can7", 0, Frame(1))


def test_a_client_may_come_back_as_often_as_it_likes(hub):
    for number in range(1, 101):
        with socket.create_connection(hub.address) as client:
            client.send(b"< open can0 >< rawmode >< send 123 0 >")
            assert poll_until(hub, lambda events: len(events) == 2)[1] == Received("can0", number, Frame(0x123))
            hub.send("can0", 10**9, Frame(1))  # never read
        assert poll_until(hub, bool) == [Detached("can0", number)]
    assert hub.clients == ()
    assert hub.dropped == {}


@pytest.mark.slow
def test_a_client_that_asks_much_and_reads_nothing_is_not_answered_for_ever(hub, connect):
    client = connect()
    asked = 0
    while asked < 20_000_000:  # more than the kernel's buffers, some MB, and the queue
        with contextlib.suppress(BlockingIOError):
            asked += client.send(b"< echo >" * 512)
        hub.poll(0)
    hub.send("can0", 10**9, Frame(1))
    assert hub.dropped == {1: 1}


def test_at_the_limit_of_open_files_a_client_is_told_and_the_hub_sleeps(hub):
    resource = pytest.importorskip("resource", reason="this system has no such limit")
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    client = socket.socket()
    descriptors = [os.dup(client.fileno())]
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (descriptors[0] + 8, limits[1]))
        with contextlib.suppress(OSError):
            while True:
                descriptors.append(os.dup(client.fileno()))
        client.connect(hub.address)
        poll_until(hub, lambda _: hub.refused == 1)
        assert client.recv(100) == TOO_MANY
        assert client.recv(100) == b""
        wakes_s = []
        for _ in range(3):
            begin_s = time.monotonic()
            assert hub.poll(0.05) == []
            wakes_s.append(time.monotonic() - begin_s)
        assert min(wakes_s) > 0.04  # it waits: nothing is readable any more
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
        for descriptor in descriptors:
            os.close(descriptor)
        client.close()
    with socket.create_connection(hub.address) as late:
        late.setblocking(False)
        assert hear(hub, late, 6) == b"< hi >"
