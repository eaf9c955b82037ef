"""How regularly SYNC arrives, as the emulator sees it on the wall clock.

It reads no clock and knows no bus: whoever receives a SYNC hands in its time.
"""

from typing import Any

from canarm_protocol.runs.histogram import Histogram

PAUSE_NS = 1_000_000_000
"""After this much silence SYNC counts as paused, not late: ten times the cards' time-out for the controller's
heartbeat."""


class SyncIntervals:
    """Intervals between SYNCs that should come every `period_ns`."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._last_ns: int | None = None
        self.jitter = Histogram()
        """|interval - period| of successive SYNCs."""
        self.count = 0
        self.gaps = 0
        """Periods that went by without a SYNC."""
        self.pauses = 0
        """Silences longer than `PAUSE_NS` between two SYNCs, such as from one run to the next. They are no jitter."""

    def note(self, now_ns: int) -> None:
        """A SYNC has arrived."""
        last_ns, self._last_ns = self._last_ns, now_ns
        self.count += 1
        if last_ns is None:
            return
        interval_ns = now_ns - last_ns
        if interval_ns > PAUSE_NS:
            self.pauses += 1
            return
        self.jitter.add(abs(interval_ns - self._period_ns))
        self.gaps += max((2 * interval_ns + self._period_ns) // (2 * self._period_ns) - 1, 0)

    def begin(self) -> None:
        """Another sender or another run begins: the interval to its first SYNC does not count."""
        self._last_ns = None

    def summary(self) -> dict[str, Any]:
        """SYNCs, gaps and pauses as counts, and the jitter as `Histogram.summary` gives it."""
        return {"syncs": self.count, "gaps": self.gaps, "pauses": self.pauses, "jitter": self.jitter.summary()}
