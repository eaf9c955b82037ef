"""Faults of the bench's time: the controller's cycle is not as long as the world's."""

from dataclasses import dataclass, field
from random import Random

from ..declaration import ClockFault, Context, Family, TapKind
from ..parameters import parameter

_CLOCK = (TapKind.CLOCK,)


@dataclass
class Drift(ClockFault, name="clock-drift", family=Family.CLOCK, acts_on=_CLOCK):
    """The controller's cycle lasts longer or shorter in the world than it believes."""

    rate: float = parameter("how much longer", "%", 5.0, -50.0, 300.0)

    def period_ns(self, nominal_ns: int, now_ns: int) -> int:
        """The cycle, scaled."""
        return round(nominal_ns * (1.0 + self.rate / 100))


@dataclass
class LateSync(ClockFault, name="late-sync", family=Family.CLOCK, acts_on=_CLOCK):
    """The controller misses its deadline, once: one SYNC comes late, and the world goes on meanwhile."""

    delay: float = parameter("by how much", "ms", 5.0, 0.0, 1000.0)
    _is_over: bool = False

    def period_ns(self, nominal_ns: int, now_ns: int) -> int:
        """One long cycle."""
        if self._is_over:
            return nominal_ns
        self._is_over = True
        return nominal_ns + round(self.delay * 1e6)


@dataclass
class Jitter(ClockFault, name="jitter", family=Family.CLOCK, acts_on=_CLOCK):
    """SYNCs come too early and too late by turns, at random."""

    amplitude: float = parameter("up to how much, either way", "ms", 0.5, 0.0, 1.0)
    _random: Random = field(default_factory=Random)
    _late_ns: int = 0

    def begin(self, context: Context) -> None:
        """Take the randomness of this activation."""
        self._random = context.random

    def period_ns(self, nominal_ns: int, now_ns: int) -> int:
        """From one SYNC's own lateness to the next one's."""
        before_ns, self._late_ns = self._late_ns, round(self._random.uniform(-1.0, 1.0) * self.amplitude * 1e6)
        return nominal_ns + self._late_ns - before_ns
