"""Faults of a signal as such: whatever the number is, and whatever carries it.

At the latch, whose value is two bits and no quantity, only those act that make no arithmetic with it.
"""

from collections import deque
from dataclasses import dataclass

from ..declaration import SCALAR_KINDS, Context, Family, SignalFault, TapKind
from ..parameters import level, of_tap, parameter

ANY_SIGNAL = SCALAR_KINDS | {TapKind.LATCH}
_PER_NS = 1e-9


@dataclass
class Stuck(SignalFault, name="stuck", family=Family.SIGNAL, acts_on=ANY_SIGNAL, is_dangerous=True):
    """The signal stays at one value."""

    value: float | None = level("where it stays; what is there when the fault begins, unless given", None)

    def apply(self, value: float, now_ns: int) -> float:
        """The same value always."""
        if self.value is None:
            self.value = value
        return self.value


@dataclass
class Offset(SignalFault, name="offset", family=Family.SIGNAL, acts_on=SCALAR_KINDS, is_dangerous=True):
    """A constant is added."""

    value: float = of_tap("what is added", 0.1, -1.0, 1.0)

    def apply(self, value: float, now_ns: int) -> float:
        """The sum."""
        return value + self.value


@dataclass
class Gain(SignalFault, name="gain", family=Family.SIGNAL, acts_on=SCALAR_KINDS, is_dangerous=True):
    """The distance from one value, `about`, is multiplied."""

    factor: float = parameter("what it is multiplied by", "", 1.5, -10.0, 10.0)
    about: float = level("the value that stays as it is; a tachometer stands still at the middle of its range", 0.0)

    def apply(self, value: float, now_ns: int) -> float:
        """A line through (about, about)."""
        return self.about + self.factor * (value - self.about)


@dataclass
class Drift(SignalFault, name="drift", family=Family.SIGNAL, acts_on=SCALAR_KINDS, is_dangerous=True):
    """An offset that grows with time, from 0."""

    rate: float = of_tap("growth of the offset", 0.1, -10.0, 10.0, per="s")

    def begin(self, context: Context) -> None:
        """Time counts from here."""
        self._begun_ns = context.now_ns

    def apply(self, value: float, now_ns: int) -> float:
        """The sum."""
        return value + self.rate * (now_ns - self._begun_ns) * _PER_NS


@dataclass
class Noise(SignalFault, name="noise", family=Family.SIGNAL, acts_on=SCALAR_KINDS, is_dangerous=True):
    """White, normally distributed noise is added, another value at every sample."""

    deviation: float = of_tap("its standard deviation", 0.05, 0.0, 1.0)

    def begin(self, context: Context) -> None:
        """Its own randomness."""
        self._random = context.random
        self._drawn_ns, self._noise = -1, 0.0

    def apply(self, value: float, now_ns: int) -> float:
        """The sum. An output passes several times at one instant: the noise is the same then."""
        if now_ns != self._drawn_ns:
            self._drawn_ns, self._noise = now_ns, self._random.gauss(0.0, self.deviation)
        return value + self._noise


@dataclass
class Spike(SignalFault, name="spike", family=Family.SIGNAL, acts_on=SCALAR_KINDS, is_dangerous=True):
    """Something is added to one sample, the first at once, then again and again."""

    height: float = of_tap("what is added", 0.5, -1.0, 1.0)
    interval: float = parameter("time from one spike to the next", "s", 0.1, 1e-3, 1e3)

    def begin(self, context: Context) -> None:
        """The first one is due."""
        self._due_ns, self._spike_ns = context.now_ns, -context.cycle_ns
        self._width_ns = context.cycle_ns // 2  # one sample, however the clock of the samples jitters

    def apply(self, value: float, now_ns: int) -> float:
        """The value, or the spike on it."""
        if now_ns >= self._due_ns:
            interval_ns = round(self.interval / _PER_NS)
            self._due_ns += ((now_ns - self._due_ns) // interval_ns + 1) * interval_ns
            self._spike_ns = now_ns
        return value + self.height if now_ns - self._spike_ns < self._width_ns else value


@dataclass
class Saturated(SignalFault, name="saturated", family=Family.SIGNAL, acts_on=SCALAR_KINDS):
    """The signal is clipped to a narrower range."""

    low: float = level("the least that goes on", 0.0)
    high: float | None = level("the most that goes on; what is there when the fault begins, unless given", None)

    def apply(self, value: float, now_ns: int) -> float:
        """The value, clipped."""
        if self.high is None:
            self.high = value
        return min(max(value, self.low), self.high)


@dataclass
class Dropout(SignalFault, name="dropout", family=Family.SIGNAL, acts_on=ANY_SIGNAL):
    """The signal is gone; something else stands in its place."""

    value: float = level("what is there instead", 0.0)

    def apply(self, value: float, now_ns: int) -> float:
        """Whatever is left without the signal."""
        return self.value


@dataclass
class Delayed(SignalFault, name="delayed", family=Family.SIGNAL, acts_on=ANY_SIGNAL, is_dangerous=True):
    """The signal comes later; until the first value is through, what is there when the fault begins stays."""

    delay: float = parameter("by how much", "s", 0.05, 0.0, 10.0)

    def begin(self, context: Context) -> None:
        """Nothing is on its way yet."""
        self._delay_ns = round(self.delay / _PER_NS)
        self._on_its_way: deque[tuple[int, float]] = deque()

    def apply(self, value: float, now_ns: int) -> float:
        """The newest value that is old enough."""
        queue = self._on_its_way
        queue.append((now_ns, value))
        while len(queue) > 1 and queue[1][0] <= now_ns - self._delay_ns:
            queue.popleft()
        return queue[0][1]


@dataclass
class Intermittent(SignalFault, name="intermittent", family=Family.SIGNAL, acts_on=ANY_SIGNAL):
    """The signal goes and comes back periodically; it goes first."""

    duty: float = parameter("share of a period without the signal", "", 0.5, 0.0, 1.0)
    frequency: float = parameter("periods a second", "Hz", 10.0, 0.01, 1000.0)
    value: float = level("what is there instead", 0.0)

    def begin(self, context: Context) -> None:
        """The first period starts here."""
        self._begun_ns = context.now_ns
        self._period_ns = round(1.0 / (self.frequency * _PER_NS))

    def apply(self, value: float, now_ns: int) -> float:
        """The value, or what replaces it."""
        phase_ns = (now_ns - self._begun_ns) % self._period_ns
        return self.value if phase_ns < self.duty * self._period_ns else value
