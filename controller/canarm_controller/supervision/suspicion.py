"""Whether angle and integrated speed may have drifted apart by the tachometer's fault.

Owns how the drift has grown, and how doubtful the speed has been meanwhile; the verdict is elsewhere.
"""

import math

SLOW_SHARE = 0.45
"""Share of a mismatch that existed 12 to 16 cycles ago if it is slow. Of a tachometer that comes to be wrong, by 0.5
rad/s in a second, it is 0.54 to 0.84; of a potentiometer that drifts by 10 % in a second, 0.39 at most."""


class Suspicion:
    """One joint. A tachometer that is wrong by a speed lets the angles drift apart by it, and shows it to the model.

    The model's observer swallows an error that comes slowly: of an acceleration a it shows a/(e·ω). So after `age` an
    error may be 1 + e·ω·age times what was seen of it, and no more. What drifts faster is the position sensor.
    """

    __slots__ = (
        "_cycles", "_hidden_per_s", "_peak_rad_s", "_period_s", "_recent", "_recent2", "_recent3", "_recent4", "_until",
    )  # fmt: skip

    def __init__(self, doubt_cycles: int, bandwidth_rad_s: float, period_s: float) -> None:
        self._cycles, self._hidden_per_s, self._period_s = doubt_cycles, math.e * bandwidth_rad_s, period_s
        self.start()

    def start(self) -> None:
        """Nothing is suspected."""
        self._until, self._peak_rad_s = -1, 0.0
        self._recent = self._recent2 = self._recent3 = self._recent4 = 0.0

    def doubt(self, cycle: int, off_rad_s: float) -> None:
        """The speed is off the model's by more than it should be."""
        self._peak_rad_s = max(abs(off_rad_s), self._peak_rad_s if cycle < self._until else 0.0)
        self._until = cycle + self._cycles

    def take(self, mismatch_rad: float) -> None:
        """Take the filtered residual of the angle in every fourth cycle."""
        self._recent4, self._recent3, self._recent2 = self._recent3, self._recent2, self._recent
        self._recent = mismatch_rad

    def is_slow(self, mismatch_rad: float) -> bool:
        """Whether much of the mismatch existed 12 to 16 cycles ago."""
        return self._recent4 * mismatch_rad > SLOW_SHARE * mismatch_rad * mismatch_rad

    def fits(self, cycle: int, mismatch_rad: float) -> bool:
        """Whether the speed was doubtful lately, and by enough for what the mismatch has grown by in 8 to 12 cycles."""
        if cycle >= self._until:
            return False
        age_s = (8 + (cycle & 3)) * self._period_s
        grown_rad_s = abs(mismatch_rad - self._recent3) / age_s
        return grown_rad_s <= self._peak_rad_s * (1.0 + self._hidden_per_s * age_s)
