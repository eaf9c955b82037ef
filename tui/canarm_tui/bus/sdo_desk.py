"""Objects of nodes read and written for the user, one conversation after the other, in the background.

All that the monitor ever sends is sent here, and only when it is asked for. Time is passed in.
"""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from canarm_protocol.canopen.frames import Cob
from canarm_protocol.canopen.sdo import SdoAborted
from canarm_protocol.decoding.sdo_texts import abort_text
from canarm_protocol.errors import BusError
from canarm_protocol.shown import named_error
from canarm_protocol.transport.sdo_session import SdoSession

from ..link import InBackground, Link
from .store import BusStore

LIMIT_S = 1.0
TOTAL_S = 15.0
BUSY_NS = 500_000_000
"""A node that somebody else has asked within this time is left alone: two clients on one channel break each other."""
MOST_WAITING = 300


class Answer(NamedTuple):
    """What became of a request: the bytes that were read (none of a write), or why it failed."""

    data: bytes = b""
    failure: str | None = None


Then = Callable[[Answer], None]


class SdoDesk:
    """Conversations over `link`. `poll` delivers the answers."""

    def __init__(self, link: Link, store: BusStore, in_background: InBackground) -> None:
        self._link, self._store, self._in_background = link, store, in_background
        self._waiting: deque[tuple[int, int, int, bytes | None, Then]] = deque()
        self._then: Then | None = None
        self._answer: Answer | None = None
        self.answered = 0
        """Grows with each answer."""

    @property
    def waiting(self) -> int:
        """Requests that are not answered yet."""
        return len(self._waiting) + (self._then is not None)

    def read(self, node_id: int, index: int, subindex: int, then: Then) -> None:
        """Read an object."""
        self._ask(node_id, index, subindex, None, then)

    def write(self, node_id: int, index: int, subindex: int, value: bytes, then: Then) -> None:
        """Write an object."""
        self._ask(node_id, index, subindex, value, then)

    def drop(self) -> None:
        """Nobody waits any more for what has not been begun."""
        self._waiting.clear()

    def poll(self, now_ns: int) -> None:
        """Deliver an answer if there is one, and begin what is next."""
        if self._then is not None and self._answer is not None:
            then, answer, self._then, self._answer = self._then, self._answer, None, None
            self.answered += 1
            then(answer)
        if self._then is None and self._waiting:
            node_id, index, subindex, value, self._then = self._waiting.popleft()
            if self._is_busy(node_id, now_ns):
                self._answer = Answer(failure="another client talks to this node just now; try again")
                return
            self._in_background(lambda: self._converse(node_id, index, subindex, value))

    def _ask(self, node_id: int, index: int, subindex: int, value: bytes | None, then: Then) -> None:
        if len(self._waiting) >= MOST_WAITING:
            then(Answer(failure=f"{MOST_WAITING} requests wait already"))
        else:
            self._waiting.append((node_id, index, subindex, value, then))

    def _is_busy(self, node_id: int, now_ns: int) -> bool:
        """Our own requests do not come back to us, so those in the store are others'."""
        row = self._store.row((Cob.SDO_TO_SERVER + node_id, False, False))
        return row is not None and now_ns - row.wall_ns < BUSY_NS

    def _converse(self, node_id: int, index: int, subindex: int, value: bytes | None) -> None:
        try:
            with self._link.lend() as port:
                request, answer = Cob.SDO_TO_SERVER + node_id, Cob.SDO_TO_CLIENT + node_id
                session = SdoSession(port, request, answer, LIMIT_S, TOTAL_S)
                if value is None:
                    self._answer = Answer(session.upload(index, subindex))
                else:
                    session.download(index, subindex, value)
                    self._answer = Answer()
        except SdoAborted as error:
            who = "" if error.by_server else "given up: "
            self._answer = Answer(failure=f"{who}{abort_text(error.code)} (0x{error.code:08X})")
        except BusError as error:
            self._answer = Answer(failure=str(error).removeprefix(f"{self._link.where}: "))
        # In its own thread an unforeseen error would vanish, and the request would stay open for ever.
        except Exception as error:
            self._answer = Answer(failure=named_error(error))
