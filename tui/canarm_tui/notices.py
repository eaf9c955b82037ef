"""What was noticed on a bus besides faults and detections: EMCY, NMT, states of nodes and controller, late cycles.

Values and their bounded memory. Who listens is elsewhere, and nothing is drawn here.
"""

from collections import deque
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple, Protocol

from canarm_protocol.cell.bench_objects import CONTROLLER_STATES

MOST_NOTICES = 500
SAME_CYCLES = 400
"""The same again within 1 s at 400 Hz is counted, and takes no line of its own."""


class Kind(Enum):
    """What a notice is about."""

    EMERGENCY = "EMCY"
    NMT = "NMT"
    NODE = "node"
    CONTROLLER = "controller"
    LATE = "late"


class Notice(NamedTuple):
    """`time_ns` is that of its bus, `cycle` that of the present run, -1 before cycle 0; `times` so often."""

    time_ns: int
    cycle: int
    kind: Kind
    what: str
    is_wrong: bool = False
    times: int = 1
    is_earlier: bool = False
    """Whether it belongs to a run before the present one."""


class Noticing(Protocol):
    """Who has noticed something."""

    @property
    def version(self) -> int:
        """Another one as soon as something has changed."""

    @property
    def kept(self) -> Sequence[Notice]:
        """Oldest first."""


class Notices:
    """The last ones of one listener."""

    def __init__(self) -> None:
        self._kept: deque[Notice] = deque(maxlen=MOST_NOTICES)
        self.version = 0
        """Another one as soon as something has changed."""

    @property
    def kept(self) -> Sequence[Notice]:
        """Oldest first."""
        return tuple(self._kept)

    def add(self, notice: Notice) -> None:
        """Keep it, or count it."""
        last = self._kept[-1] if self._kept else None
        if last is not None and _is_same(last, notice):
            self._kept[-1] = last._replace(times=last.times + notice.times)
        else:
            self._kept.append(notice)
        self.version += 1

    def begin_run(self) -> None:
        """What was noticed so far belongs to an earlier run."""
        self._kept = deque((each._replace(is_earlier=True) for each in self._kept), maxlen=MOST_NOTICES)
        self.version += 1

    def clear(self) -> None:
        """Begin anew."""
        self._kept.clear()
        self.version += 1


class ControllerNotices(Notices):
    """From what a controller reports on the bench bus."""

    def __init__(self) -> None:
        super().__init__()
        self._last: tuple[int, int, int] | None = None

    def clear(self) -> None:
        """Begin anew: whatever is reported next is news."""
        super().clear()
        self._last = None

    def take(self, tick: int, late: int, state: int, time_ns: int) -> None:
        """It has reported. A tick that goes back is another run's."""
        before, self._last = self._last, (tick, late, state)
        if before is not None and tick < before[0]:
            self.begin_run()
            before = None
        if before is None or state != before[2]:
            name = CONTROLLER_STATES.get(state, f"state {state}")
            self.add(Notice(time_ns, tick, Kind.CONTROLLER, f"controller {name}", name == "failed"))
        if before is not None and late > before[1]:
            self.add(Notice(time_ns, tick, Kind.LATE, "cycles missed or begun late", True, late - before[1]))

    def lost(self, tick: int, time_ns: int, cycle: int) -> None:
        """It had the robot, and has reported no more since `tick`, while the bench goes on."""
        self.add(Notice(time_ns, cycle, Kind.CONTROLLER, f"controller lost: no report since cycle {tick}", True))


def _is_same(last: Notice, notice: Notice) -> bool:
    is_soon = 0 <= notice.cycle - last.cycle <= SAME_CYCLES
    return is_soon and not last.is_earlier and (last.kind, last.what) == (notice.kind, notice.what)
