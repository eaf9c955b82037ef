"""When cycles are due by the wall clock, and how well that was kept.

Owns the grid of deadlines, the counts, and the pace of lockstep. Waiting and sending are left to the runner.
docs/wall-clock.md defines "late" and "missed".
"""

import time
from collections.abc import Callable
from typing import Any

from canarm_protocol.runs.histogram import Histogram

LATE_FRACTION = 10
"""A SYNC is late if it is sent more than a tenth of the period after its deadline."""
STALL_NS = 100_000_000
"""A longer delay is a stall: the machine slept, or the process stopped. As long as the cards' heartbeat time-out."""

LAG_NS = 100_000_000
"""Lockstep may exceed its pace to catch up by this much after a hitch; more would be visible as a jump."""


class Pacer:
    """Absolute deadlines one period apart. A stall of more than a period leaves out the deadlines that it missed."""

    def __init__(self, period_ns: int, clock: Callable[[], int] = time.perf_counter_ns) -> None:
        self._period_ns, self._clock = period_ns, clock
        self.next_ns = clock()
        self._sync_ns: int | None = None
        self.lateness = Histogram()
        """From the deadline of a SYNC to its sending."""
        self.jitter = Histogram()
        """|interval - period| of successive SYNCs."""
        self.answer = Histogram()
        """From SYNC to the last TPDO of its cycle."""
        self.computing = Histogram()
        """From the last TPDO of a cycle until its outputs have been handed to the bus."""
        self.law = Histogram()
        """The law's part of that."""
        self.late = 0
        self.missed = 0
        """Deadlines that were left out."""
        self.stalls = 0

    def left_s(self) -> float:
        """Seconds to the next deadline; not positive when it has come."""
        return (self.next_ns - self._clock()) * 1e-9

    def begin(self, counts: bool = True) -> None:
        """The deadline has come: count its lateness, and set the next one.

        A deadline that does not count, such as one of a safe stop, is neither late nor left out.
        """
        now_ns = self._clock()
        period_ns = self._period_ns
        delay_ns = max(now_ns - self.next_ns, 0)
        self.lateness.add(delay_ns)
        if self._sync_ns is not None:
            self.jitter.add(abs(now_ns - self._sync_ns - period_ns))
        self._sync_ns = now_ns
        skipped = delay_ns // period_ns
        if counts and delay_ns * LATE_FRACTION > period_ns:
            self.late += 1
            self.stalls += delay_ns > STALL_NS
            self.missed += skipped
        self.next_ns += period_ns * (1 + skipped)

    def controlled(self, inputs_ns: int, law_ns: int = 0) -> None:
        """The outputs of this cycle have just been handed to the bus; its inputs were complete at `inputs_ns`.

        `law_ns` is what the law took of that.
        """
        self.computing.add(self._clock() - inputs_ns)
        self.law.add(law_ns)
        if self._sync_ns is not None:
            self.answer.add(inputs_ns - self._sync_ns)

    def summary(self) -> dict[str, Any]:
        """Counts, and the five durations as `Histogram.summary` gives them."""
        return {
            "period_us": self._period_ns / 1000.0,
            "late": self.late,
            "left_out": self.missed,
            "stalls": self.stalls,
            "lateness": self.lateness.summary(),
            "jitter": self.jitter.summary(),
            "answer": self.answer.summary(),
            "computing": self.computing.summary(),
            "law": self.law.summary(),
        }


class LockstepPace:
    """Holds lockstep back: virtual time passes `rate` times as fast as the wall clock at most.

    Delays beyond `LAG_NS` are not made up for.
    """

    def __init__(self, period_ns: int, rate: float, clock: Callable[[], int] = time.perf_counter_ns) -> None:
        self._interval_ns = period_ns / rate
        self._clock = clock
        self._start_ns = float(clock())

    def left_s(self, tick: int) -> float:
        """Seconds until the SYNC of `tick` may be sent."""
        late_ns = self._clock() - self._start_ns - tick * self._interval_ns
        if late_ns > LAG_NS:
            self._start_ns += late_ns
        return max(-late_ns * 1e-9, 0.0)
