"""Whether cycles were late for lack of computing time, and whether the law or the machine took it.

Owns only that judgement; the robot and buses never enter.
"""

from collections import deque
from dataclasses import dataclass

from canarm_protocol.canopen.frames import ErrorCode, NmtState

WINDOW_NS = 1_000_000_000
"""Left-out cycles explain detections for this long: filters of the watch forget in one or two tenths of a second."""
ENOUGH_CYCLES = 16
"""With this many cycles left out within `WINDOW_NS` the run is starved; the watch tolerates fewer."""
LAW_SHARE = 0.5
"""The law is to blame if it took at least this share of the lost time."""
SELDOM = 100
"""A run that has lost less than one cycle in this many is not called starved."""
LONG_NS = 1_000_000_000
"""A law that takes longer than this in lockstep may exceed the time-out of others."""
UNTOUCHED = frozenset(
    (
        "foreign-master",
        "deadline-missed",
        "law-output",
        "law-failed",
        "interrupted",
        "recording-failed",
    )
)
"""Detectors whose findings lack of computing time cannot explain."""
SILENCE = frozenset(("card-emergency", "heartbeat-lost"))
"""Detectors of silence, which lack of computing time explains in lockstep too."""
HEARTBEAT_LOST = f"0x{ErrorCode.LIFE_GUARD_OR_HEARTBEAT:04X}"
RESTARTED = f" {NmtState.BOOT_UP.name},"
"""The state of a card that has started anew; no missed heartbeat of the controller leads to it."""


def explains(detector: str, detail: str, *, is_lockstep: bool) -> bool:
    """Whether lack of computing time can explain what `detector` has found."""
    if detector == "card-state":
        return RESTARTED not in detail
    if detector == "card-emergency":
        return HEARTBEAT_LOST in detail
    return detector in SILENCE if is_lockstep else detector not in UNTOUCHED


@dataclass(frozen=True, slots=True)
class _Loss:
    """Deadlines that were left out at `at_ns`, and how long the law had taken just before."""

    at_ns: int
    cycles: int
    law_ns: int


class Starvation:
    """Collects the left-out cycles of a run; `period_ns` is the length of one."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._recent: deque[_Loss] = deque()
        self._all: list[int] = [0, 0, 0]
        self._law_ns = 0

    def law(self, law_ns: int) -> None:
        """The law took `law_ns` in the cycle that ends now; it may be the cause of the next loss."""
        self._law_ns = law_ns

    def left_out(self, now_ns: int, cycles: int) -> None:
        """`cycles` deadlines have been left out."""
        loss = _Loss(now_ns, cycles, self._law_ns)
        self._recent.append(loss)
        self._all = _added(self._all, loss, self._period_ns)

    def cause(self, now_ns: int) -> str | None:
        """Why the run has been starved lately; None if it has not."""
        recent = self._recent
        while recent and now_ns - recent[0].at_ns > WINDOW_NS:
            recent.popleft()
        total = [0, 0, 0]
        for loss in recent:
            total = _added(total, loss, self._period_ns)
        return self._text(*total) if total[0] >= ENOUGH_CYCLES else None

    def of_the_run(self, ticks: int) -> str | None:
        """As `cause`, for all `ticks` cycles of a run; None where fewer than one in `SELDOM` was lost."""
        cycles = self._all[0]
        return self._text(*self._all) if cycles >= ENOUGH_CYCLES and cycles * SELDOM >= ticks else None

    def _text(self, cycles: int, law_lost_ns: int, longest_ns: int) -> str:
        lost = f"{cycles} cycles of {self._period_ns / 1e6:g} ms were left out"
        if law_lost_ns >= LAW_SHARE * cycles * self._period_ns:
            return f"the law took up to {_time_text(longest_ns)} a cycle: {lost}"
        return f"this machine kept the controller waiting: {lost}. Lockstep (--clock sync) bears a busy machine"


def _added(total: list[int], loss: _Loss, period_ns: int) -> list[int]:
    """Cycles lost, ns of them that the law took, and its longest time, with one more loss."""
    cycles, law_lost_ns, longest_ns = total
    return [
        cycles + loss.cycles,
        law_lost_ns + min(loss.law_ns, loss.cycles * period_ns),
        max(longest_ns, loss.law_ns),
    ]


def long_law(law_ns: int, tick: int) -> str | None:
    """In lockstep: a warning that the law has just taken longer than others may wait; None otherwise."""
    if law_ns < LONG_NS:
        return None
    return f"the law took {law_ns / 1e9:.3g} s in cycle {tick}, longer than others wait; --sync-timeout sets how long"


def _time_text(time_ns: int) -> str:
    return f"{time_ns / 1e9:.3g} s" if time_ns >= 1_000_000_000 else f"{time_ns / 1e6:.3g} ms"
