"""One client of the virtual bus: its parser, its place in the protocol, its bounded output queue.

It has no list of clients and forwards nothing. It is told the wall-clock time, for the pause after a handshake and for
statistics.
"""

import socket
from dataclasses import dataclass

from canarm_protocol.transport.socketcand_server import Mode, ServerParser

HOLD_S = 0.05
"""Pause between `< rawmode >` and the first frame; any input of the client ends it early.

python-can's client breaks when a frame shares a TCP segment with the `< ok >` of its handshake.
"""
MOST_SUBSCRIPTIONS = 4096
"""IDs that one client can subscribe to."""
SHORTEST_STATISTICS_S = 0.01
"""Shortest interval of statistics; socketcand checks this often whether they are due (statistics.c)."""


@dataclass(frozen=True, slots=True)
class ClientInfo:
    """A connection as it stands. `channel` is `None` before `< open >`; `dropped` and `malformed` are counts."""

    client_id: int
    address: str
    channel: str | None
    is_receiving: bool
    dropped: int
    malformed: int


class Connection:
    """One client, told of the time in s of the wall clock where that matters. `queue_bytes` bounds its queue."""

    __slots__ = (
        "_held_until_s",
        "_queue_bytes",
        "_statistics_due_s",
        "_statistics_s",
        "address",
        "channel",
        "client_id",
        "dropped",
        "fd",
        "garbage_before",
        "held",
        "is_told",
        "mode",
        "output",
        "parser",
        "socket",
        "subscribed",
    )

    def __init__(self, connection: socket.socket, client_id: int, address: str, queue_bytes: int) -> None:
        self.socket = connection
        self.fd = connection.fileno()
        self.client_id = client_id
        self.address = address
        self.parser = ServerParser()
        self.channel: str | None = None
        self.mode = Mode.BCM
        self.subscribed: set[tuple[int, bool]] = set()
        """(CAN ID, is extended) of the frames that it wants in BCM mode."""
        self.output = bytearray()
        self.held: bytearray | None = None
        """Frames queued during the pause after `< rawmode >`; `None` outside it."""
        self.dropped = 0
        """Frames that did not fit into its queue."""
        self.garbage_before = 0
        self.is_told = False
        """Whether unreadable input of this client has been reported."""
        self._queue_bytes = queue_bytes
        self._held_until_s = 0.0
        self._statistics_s: float | None = None
        self._statistics_due_s = 0.0

    def info(self) -> ClientInfo:
        """The connection as it stands."""
        return ClientInfo(
            client_id=self.client_id,
            address=self.address,
            channel=self.channel,
            is_receiving=self.channel is not None and self.mode is Mode.RAW,
            dropped=self.dropped,
            malformed=self.parser.malformed,
        )

    @property
    def waits_for_time(self) -> bool:
        """Whether `wait` will have something to do."""
        return self.held is not None or self._statistics_s is not None

    def wait(self, now_s: float, timeout_s: float) -> tuple[float, bool]:
        """`timeout_s`, shortened to what this client waits for, and whether statistics are due now."""
        if self.held is not None:
            remaining_s = self._held_until_s - now_s
            if remaining_s > 0:
                timeout_s = min(timeout_s, remaining_s)
            else:
                self.release()
        if self._statistics_s is None:
            return timeout_s, False
        is_due = now_s >= self._statistics_due_s
        if is_due:
            self._statistics_due_s = now_s + self._statistics_s
        return min(timeout_s, max(self._statistics_due_s - now_s, 0.0)), is_due

    def change_mode(self, mode: Mode, now_s: float) -> None:
        """Enter a mode, with nothing subscribed; to enter the one that it is in changes nothing.

        socketcand closes the one socket and opens the other.
        """
        if mode is self.mode:
            return
        self.mode = mode
        self.subscribed.clear()
        self._statistics_s = None
        if mode is Mode.RAW:
            self.held = bytearray()
            self._held_until_s = now_s + HOLD_S

    def ask_statistics(self, interval_s: float, now_s: float) -> None:
        """From now on the client gets statistics every `interval_s`; 0 ends that."""
        self._statistics_s = max(interval_s, SHORTEST_STATISTICS_S) if interval_s else None
        self._statistics_due_s = now_s + interval_s

    def queue(self, element: bytes) -> bool:
        """Queue a whole frame, or count it as dropped; returns whether it fitted."""
        queue = self.output if self.held is None else self.held
        if len(queue) + len(element) > self._queue_bytes:
            self.dropped += 1
            return False
        queue += element
        return True

    def reply(self, element: bytes) -> None:
        """Queue an answer, unless the client asks a lot and reads nothing."""
        if len(self.output) + len(element) <= self._queue_bytes:
            self.output += element

    def release(self) -> None:
        """The pause after the handshake is over."""
        if self.held is not None:
            self.output += self.held
            self.held = None

    def flush(self) -> bool:
        """One non-blocking send; the rest stays queued. False when the client is gone."""
        try:
            sent = self.socket.send(self.output)
        except BlockingIOError:
            return True
        except OSError:
            return False
        del self.output[:sent]
        return True
