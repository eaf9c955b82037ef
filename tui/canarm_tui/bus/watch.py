"""A bus that is watched: its connection, drained often, and the store that it fills. Only its desk ever sends."""

from collections.abc import Callable, Sequence
from typing import Protocol

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.model import Cell
from canarm_protocol.decoding import Book, Decoder, robot_book
from canarm_protocol.errors import BusError
from canarm_protocol.transport.port import BusPort

from ..link import InBackground, Link, in_thread
from .address import BusAddress
from .sdo_desk import SdoDesk
from .store import BusNow, BusStore

MOST_UNSEEN = 6000
"""Frames within `UNSEEN_NS` of wall time that are read for nobody, for some 6 % of a core: more than robots at 400 Hz
have to say, and less than lockstep at full speed has, which must not wait for that."""
UNSEEN_NS = 1_000_000_000


class Listener(Protocol):
    """Is given all frames of a bus."""

    def receive(self, frames: Sequence[tuple[int, Frame]]) -> None:
        """Take frames, in order."""

    def forget(self) -> None:
        """What comes from now on begins anew."""


class BusWatch:
    """A source of the dashboard. It opens its bus when it is first wanted (`wake`), or told to `listen`."""

    def __init__(
        self,
        book: Book,
        open_port: Callable[[], BusPort],
        where: str,
        bitrate: int | None = None,
        in_background: InBackground = in_thread,
    ) -> None:
        self.book, self.decoder = book, Decoder(book)
        self.store = BusStore(self.decoder, bitrate)
        self.link = Link(open_port, where, node_id=None, in_background=in_background)
        self.desk = SdoDesk(self.link, self.store, in_background)
        self.listeners: list[Listener] = []
        self.is_awake = False
        self._connections = 0
        self._is_wanted = False
        self._unseen, self._unseen_until_ns = 0, 0

    @property
    def is_behind(self) -> bool:
        """Whether frames are there that have not been taken yet, as where a record is read."""
        return False

    @property
    def changes(self) -> object:
        """Another one as soon as something has come, or the connection is another."""
        return self.store.version, self.link.state, self.link.reason, self.desk.answered

    def wake(self) -> None:
        """Somebody looks: open the bus, and keep it open."""
        self.is_awake = self._is_wanted = True

    def listen(self) -> None:
        """Open the bus although nobody looks yet, and give it back if too much comes: `MOST_UNSEEN`."""
        self.is_awake = True

    def poll(self, now_ns: int) -> None:
        """Take what has arrived, without waiting. Raises nothing."""
        if not self.is_awake:
            return
        frames = self.link.poll(now_ns)
        if self.link.connections != self._connections:
            self._connections = self.link.connections
            self.store.reconnected()
        if not self._is_wanted and self._is_too_much(len(frames), now_ns):
            self.is_awake = False
            self.link.reopen()  # not before somebody looks
            self.clear()
            return
        self.take(frames, now_ns)

    def _is_too_much(self, frames: int, now_ns: int) -> bool:
        if now_ns >= self._unseen_until_ns:
            self._unseen, self._unseen_until_ns = 0, now_ns + UNSEEN_NS
        self._unseen += frames
        return self._unseen > MOST_UNSEEN

    def take(self, frames: Sequence[tuple[int, Frame]], now_ns: int) -> None:
        """These frames have arrived."""
        self.store.receive(frames, now_ns)
        for listener in self.listeners:
            listener.receive(frames)
        self.desk.poll(now_ns)

    def clear(self) -> None:
        """Begin anew with everything that comes from now on."""
        self.store.clear()
        for listener in self.listeners:
            listener.forget()

    def now(self, now_ns: int) -> BusNow:
        """The bus as received so far."""
        return self.store.now(now_ns)

    def close(self) -> None:
        """Give the bus back."""
        self.link.close()


UNNAMED = "the robot's bus was not named; start the dashboard with -i and -c of it, such as -i socketcan -c vcan0"


def robot_watch(cell: Cell, address: BusAddress | None, in_background: InBackground = in_thread) -> BusWatch:
    """The robot's bus of `cell` at `address`; without one it says what is missing."""

    def refuse() -> BusPort:
        raise BusError(UNNAMED)

    if address is None:
        return BusWatch(robot_book(cell), refuse, "no bus", cell.bus.bitrate, in_background)
    return BusWatch(robot_book(cell), address.open, address.where, cell.bus.bitrate, in_background)
