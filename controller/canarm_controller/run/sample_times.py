"""When the inputs of a cycle were sampled, as far as the controller can know: the time of SYNC, or of an earlier one.

Owns the time between one measurement and the next. What was measured never enters.
"""

from typing import NamedTuple

from canarm_protocol.clock import Clock

SKEW_FRACTION = 5
"""An interval counts as one cycle if it is off by less than a fifth of it: at 2 rad/s that is 0.05 LSB of angle."""
CLEAR_CYCLES, UNCLEAR_ANSWERS = 4, 2
"""An answer that is more than this many cycles late, or after the one before, follows a stall; this many answers may
then belong to a SYNC before the stall or after it."""


class Sample(NamedTuple):
    """What is known of the time at which one cycle's inputs were sampled."""

    is_on_time: bool
    """Whether that was one cycle after the last ones, so that they can be compared with predictions."""
    is_unclear: bool
    """Whether it is unknown to which SYNC they belong."""
    excess_s: float
    """Time since the last ones, less that of the predicted cycles."""
    left_out_s: float
    """Longest time without predictions."""
    shift_s: float
    """Small excess of a sample that is on time."""


ON_TIME = Sample(True, False, 0.0, 0.0, 0.0)


class SampleTimes:
    """Times of the samples of one run, in cycles of `period_ns`; an ADC needs `scan_ns` for its last channel."""

    def __init__(self, clock: Clock, period_ns: int, scan_ns: int) -> None:
        self.missing_cycles = 0
        """Cycles without inputs since the last sample."""
        self._is_lockstep = clock is Clock.SYNC
        self._period_ns, self._scan_ns = period_ns, scan_ns
        self._arrived_ns = 0
        self._sync_ns: int | None = None
        self._sampled_ns: int | None = None
        self._excess_s = 0.0
        self._unclear_answers, self._unclear_s = 0, 0.0

    def open_cycle(self, now_ns: int | None) -> None:
        """SYNC goes out, on the wall clock at `now_ns`."""
        self._sync_ns = now_ns

    def arrive(self, now_ns: int) -> None:
        """Inputs have arrived."""
        self._arrived_ns = now_ns

    def delay(self, late_ns: int) -> None:
        """In lockstep, the SYNC of the cycle was late."""
        self._excess_s += late_ns * 1e-9

    def mistrust(self) -> None:
        """The next answers may be those to an earlier SYNC."""
        self._unclear_answers = UNCLEAR_ANSWERS

    def take(self) -> Sample:
        """The cycle's inputs are complete and are used now."""
        if self._is_lockstep and not (self._excess_s or self._unclear_answers):
            self.missing_cycles = 0
            return ON_TIME
        is_cycle = not self._excess_s if self._is_lockstep else self._is_cycle()
        is_unclear, excess_s = self._unclear_answers > 0, self._excess_s
        left_out_s = self._unclear_s if is_unclear else max(excess_s, 0.0)
        is_on_time = is_cycle and not is_unclear
        if not is_on_time:
            self._excess_s = 0.0
            self._unclear_answers -= is_unclear
        self.missing_cycles = 0
        return Sample(is_on_time, is_unclear, excess_s, left_out_s, excess_s if is_cycle else 0.0)

    def _is_cycle(self) -> bool:
        """Whether these inputs were sampled a cycle after the last.

        They are sampled when the cards receive SYNC. If the answer is prompt, that is when SYNC was sent; an answer
        that comes before the scan can be over belongs to the last cycle. `_excess_s` accumulates the time beyond the
        predicted cycles in any case, so that angles integrated over many cycles stay right.

        After a stall, of this machine or of the cards, it is unknown to which SYNC the next answers belong.
        """
        period_ns = self._period_ns
        sync_ns = self._arrived_ns if self._sync_ns is None else self._sync_ns
        is_old = self._sync_ns is not None and self._arrived_ns - sync_ns < self._scan_ns
        sampled_ns = sync_ns - period_ns if is_old else sync_ns
        last_ns, self._sampled_ns = self._sampled_ns, sampled_ns
        predicted = self.missing_cycles
        excess_ns = 0 if last_ns is None else sampled_ns - last_ns - (1 + predicted) * period_ns
        self._excess_s = excess_ns * 1e-9
        unclear_ns = max(excess_ns, self._arrived_ns - sampled_ns)
        if unclear_ns > CLEAR_CYCLES * period_ns:
            self._unclear_answers, self._unclear_s = UNCLEAR_ANSWERS, unclear_ns * 1e-9
        is_cycle = not predicted and abs(excess_ns) * SKEW_FRACTION < period_ns
        return is_cycle and not is_old and 2 * (self._arrived_ns - sampled_ns) < period_ns
