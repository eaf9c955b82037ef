"""Whether cycles were late for want of computing time, and who took it: the law or the machine.

Owns that judgement alone. What the robot does meanwhile is no business of this file, and neither is any bus.
"""

from collections import deque
from dataclasses import dataclass

from canarm_protocol.canopen.frames import ErrorCode

WINDOW_NS = 1_000_000_000
"""What was left out explains what is seen for so long: filters of the watch forget in a tenth of a second or two."""
ENOUGH_CYCLES = 16
"""Cycles left out within `WINDOW_NS` from which on the run is starved; fewer, here and there, the watch bears."""
LAW_SHARE = 0.5
"""The law is to blame when it took at least this share of the time that was lost."""
SELDOM = 100
"""A run that has lost less than one cycle in so many is not called starved."""
LONG_NS = 1_000_000_000
"""In lockstep time costs nothing; but a law that takes longer than this may outlast somebody's patience."""
UNTOUCHED = frozenset(
    (
        "foreign-master",
        "card-state",
        "inputs-repeated",
        "deadline-missed",
        "law-output",
        "law-failed",
        "interrupted",
        "recording-failed",
    )
)
"""Detectors whose findings no want of time can explain."""
SILENCE = frozenset(("card-emergency", "heartbeat-lost"))
"""Detectors that tell when a node has been waited for in vain, in lockstep too."""
HEARTBEAT_LOST = f"0x{ErrorCode.LIFE_GUARD_OR_HEARTBEAT:04X}"


def explains(detector: str, detail: str, *, is_lockstep: bool) -> bool:
    """Whether a lack of computing time can be behind what `detector` has found."""
    if detector == "card-emergency":
        return HEARTBEAT_LOST in detail
    return detector in SILENCE if is_lockstep else detector not in UNTOUCHED


@dataclass(frozen=True, slots=True)
class _Loss:
    """Deadlines that went by unused at `at_ns`, and how long the law had taken just before."""

    at_ns: int
    cycles: int
    law_ns: int


class Starvation:
    """Gathers the cycles of a run that came too late to be kept; `period_ns` is the length of one."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._recent: deque[_Loss] = deque()
        self._all: list[int] = [0, 0, 0]
        self._law_ns = 0

    def law(self, law_ns: int) -> None:
        """The law took `law_ns` in the cycle that ends now; what is lost next, it may have cost."""
        self._law_ns = law_ns

    def left_out(self, now_ns: int, cycles: int) -> None:
        """`cycles` deadlines have gone by unused."""
        loss = _Loss(now_ns, cycles, self._law_ns)
        self._recent.append(loss)
        self._all = _added(self._all, loss, self._period_ns)

    def cause(self, now_ns: int) -> str | None:
        """Why the run is starved of late; None while it is not."""
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
    """In lockstep: that the law has just taken longer than somebody's patience may last; None otherwise."""
    if law_ns < LONG_NS:
        return None
    return f"the law took {law_ns / 1e9:.3g} s in cycle {tick}, longer than others wait; --sync-timeout sets how long"


def _time_text(time_ns: int) -> str:
    return f"{time_ns / 1e9:.3g} s" if time_ns >= 1_000_000_000 else f"{time_ns / 1e6:.3g} ms"
