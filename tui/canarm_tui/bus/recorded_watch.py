"""The robot's bus of a recorded run, as far as the record has been played. There is no bus, and nothing can be sent."""

from collections.abc import Callable, Iterator

from canarm_protocol.canopen.frames import Cob, Frame, NmtCommand
from canarm_protocol.decoding import Book
from canarm_protocol.errors import BusError
from canarm_protocol.transport.port import BusPort

from ..link import LinkState
from .watch import BusWatch

MOST_AT_ONCE = 5000
"""Frames that are taken in one go, so that a jump far ahead cannot block the keyboard."""
PIECE = 250
"""Frames after which load and rates have a mark: after a jump too they are of the last seconds."""
RECORDED = "a recorded run has no bus"


class RecordedWatch(BusWatch):
    """`frames` gives the recorded frames from the beginning, `cycle` where the record is. Back is anew, from there."""

    def __init__(
        self,
        book: Book,
        frames: Callable[[], Iterator[tuple[int, Frame]]],
        cycle: Callable[[], int],
        where: str,
        bitrate: int | None,
    ) -> None:
        super().__init__(book, _refuse, where, bitrate, lambda job: job())
        self.link.state, self.link.is_live, self.link.reason = LinkState.CONNECTED, False, RECORDED
        self.store.meter.follows_record = True
        self._frames_of, self._wanted = frames, cycle
        self._frames: Iterator[tuple[int, Frame]] | None = None
        self._next: tuple[int, Frame] | None = None
        self._cycle = -1
        self._has_more = True

    @property
    def is_behind(self) -> bool:
        """Whether the log has not been read up to where the record is."""
        return self._has_more or self._wanted() < self._cycle

    @property
    def changes(self) -> object:
        """Another one when all has been read, too."""
        return super().changes, self._has_more

    def poll(self, now_ns: int) -> None:
        """Take what has been played since the last time. Raises nothing."""
        if not self.is_awake:
            return
        wanted = self._wanted()
        if self._frames is None or wanted < self._cycle:
            self.clear()
            self._frames, self._next, self._cycle = self._frames_of(), None, -1
        frames = self._until(wanted)
        self._has_more = len(frames) >= MOST_AT_ONCE
        for first in range(0, max(1, len(frames)), PIECE):
            self.take(frames[first : first + PIECE], now_ns)

    def _until(self, wanted: int) -> list[tuple[int, Frame]]:
        """The frames up to the end of a cycle: up to the SYNC that begins the next one."""
        assert self._frames is not None
        found: list[tuple[int, Frame]] = []
        while len(found) < MOST_AT_ONCE:
            stamped = self._next or next(self._frames, None)
            self._next = None
            if stamped is None:
                break
            can_id, data = stamped[1][0], stamped[1][1]
            if can_id == Cob.SYNC:
                if self._cycle >= wanted:
                    self._next = stamped
                    break
                self._cycle += 1
            elif can_id == Cob.NMT and data[:1] == bytes((NmtCommand.START,)):
                self._cycle = -1
            found.append(stamped)
        return found


def _refuse() -> BusPort:
    raise BusError(RECORDED)
