"""What the server of the virtual buses counts a bus: clients attached, frames dropped."""

import socket
import time
from collections.abc import Iterator

import pytest

from canarm_emulator.errors import HubError
from canarm_emulator.serving.hub import Hub
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.transport.socketcand import format_frame

DEADLINE_S = 60.0
FRAME = Frame(0x123, bytes(8))


@pytest.fixture
def hub() -> Iterator[Hub]:
    # Room for the handshake and two frames.
    hub = Hub(port=0, queue_bytes=2 * len(format_frame(FRAME, 0)))
    yield hub
    hub.close()


def attach(hub: Hub, channel: str) -> socket.socket:
    client = socket.create_connection(hub.address)
    client.sendall(b"< open %b >< rawmode >" % channel.encode())
    before, deadline_s = hub.attached_to(channel), time.monotonic() + DEADLINE_S
    while hub.attached_to(channel) == before:
        assert time.monotonic() < deadline_s
        hub.poll(0.01)
    return client


def test_clients_are_counted_by_bus_and_no_longer_when_they_are_gone(hub: Hub) -> None:
    clients = [attach(hub, channel) for channel in ("can0", "can0", "bench")]
    assert (hub.attached_to("can0"), hub.attached_to("bench")) == (2, 1)
    clients[0].close()
    while hub.attached_to("can0") == 2:
        hub.poll(0.01)
    assert (hub.attached_to("can0"), hub.attached_to("bench")) == (1, 1)
    for client in clients[1:]:
        client.close()


def test_dropped_frames_are_counted_by_bus_and_outlive_their_client(hub: Hub) -> None:
    clients = [attach(hub, channel) for channel in ("can0", "bench")]
    for _ in range(5):
        hub.send("can0", 0, FRAME)
    hub.send_error("can0", 0, 0x88)
    # Held back after the handshake, two frames fit; three and the error frame do not.
    assert (hub.dropped_on("can0"), hub.dropped_on("bench")) == (4, 0)
    clients[0].close()
    while hub.attached_to("can0"):
        hub.poll(0.01)
    assert hub.dropped_on("can0") == 4
    clients[1].close()


def test_a_bus_that_is_not_served_has_no_counts(hub: Hub) -> None:
    for count in (hub.attached_to, hub.dropped_on):
        with pytest.raises(HubError, match="'can7' is not served; served are can0, bench"):
            count("can7")
