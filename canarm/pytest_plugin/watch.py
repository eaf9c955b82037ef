"""The robot's bus as seen by a silent listener: frames, NMT commands, emergencies, heartbeats.

A thread reads, so that nothing is lost while a test waits for something else.
"""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID, Cob, Emergency, Frame, NmtCommand, NmtState, parse_nmt
from canarm_protocol.errors import BusError, FrameError
from canarm_protocol.transport.port import BusPort

FRAMES_KEPT = 100_000
READ_S = 0.1
"""How often the reader checks whether to end."""
LOOK_S = 0.05
"""How often a condition is checked while the bus is silent."""


class SeenFrame(NamedTuple):
    """A frame with the bus's own time: virtual time in lockstep."""

    time_s: float
    frame: Frame


class SeenNmt(NamedTuple):
    """An NMT command; `node_id` 0 is all nodes."""

    time_s: float
    command: NmtCommand
    node_id: int


class SeenEmergency(NamedTuple):
    """An EMCY from a node."""

    time_s: float
    node_id: int
    code: int
    register: int


class BusWatch:
    """Listens on `port` from now on; closes it at the end."""

    def __init__(self, port: BusPort) -> None:
        self.frames: deque[SeenFrame] = deque(maxlen=FRAMES_KEPT)
        self.nmt: list[SeenNmt] = []
        self.emergencies: list[SeenEmergency] = []
        self.heartbeats: dict[int, tuple[float, NmtState]] = {}
        """The last heartbeat of each node: time and state."""
        self.time_s = 0.0
        """Bus time of the last frame."""
        self.lost: str | None = None
        """The reason if the bus is lost."""
        self._port = port
        self._news = threading.Condition()
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def wait_for(self, condition: Callable[[], object], timeout_s: float) -> bool:
        """Whether `condition` becomes true within `timeout_s` of wall time; checked per frame and every `LOOK_S`."""
        deadline_s = time.monotonic() + timeout_s
        while not condition():
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0:
                return False
            with self._news:
                self._news.wait(min(left_s, LOOK_S))
        return True

    def close(self) -> None:
        """Stop listening. May be called again."""
        self._is_over.set()
        self._thread.join(10.0)
        self._port.close()

    def _read(self) -> None:
        try:
            while not self._is_over.is_set():
                batch = self._port.receive(READ_S)
                if batch:
                    for time_ns, frame in batch:
                        self._take(time_ns * 1e-9, frame)
                    with self._news:
                        self._news.notify_all()
        except BusError as error:
            self.lost = str(error)

    def _take(self, time_s: float, frame: Frame) -> None:
        self.frames.append(SeenFrame(time_s, frame))
        self.time_s = time_s
        if frame.is_extended or frame.is_remote:
            return
        kind, node_id = frame.can_id & ~HIGHEST_NODE_ID, frame.can_id & HIGHEST_NODE_ID
        try:
            if frame.can_id == Cob.NMT:
                self.nmt.append(SeenNmt(time_s, *parse_nmt(frame.data)))
            elif kind == Cob.EMERGENCY and node_id:
                emergency = Emergency.parse(frame.data)
                self.emergencies.append(SeenEmergency(time_s, node_id, emergency.code, emergency.register))
            elif kind == Cob.HEARTBEAT and node_id and len(frame.data) == 1:
                self.heartbeats[node_id] = time_s, NmtState(frame.data[0])
        except (FrameError, ValueError):
            return  # malformed: it stands in `frames`
