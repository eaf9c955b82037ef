"""A joint without a tachometer: its speed comes from position sensor and model, which check each other.

Owns what can be judged with two witnesses. With a tachometer there are three, see `witness`.
"""

import math

from ..estimation.blind import blind_pole_rad_s
from .detection import Reaction
from .joint_state import Mode
from .limits import Report
from .nominal import ROUNDING_LSB, JointNominal
from .read_speed import ReadSpeed
from .sensor_less import BLIND_FACTOR, PERSISTENT_CYCLES, SensorLess
from .thresholds import REFERENCE_NOISE, STUCK_TRAVEL, TIMING_SHARE, Thresholds, unmodelled_rad_s2
from .timing import Timing
from .uncertainty import COULOMB

_BLIND = Mode.BLIND  # an enum's attribute is slow
STRUCK_S = 0.02
"""How long a joint that strikes a stop is pushed back: five times the 4 ms of a bumper."""
STUCK_FACTOR, STUCK_CYCLES = 1.6, 6
"""Factor on the travel over which a code may stand still, and the least number of cycles of a stuck code."""
UNLEARNED_SHARE = 0.2
"""Share of a right model's error that the observer has not yet learned when the code last changed."""

LEARNS_LONGER = 2.5
"""The observer of 12 rad/s takes so many times as long as that of 30 rad/s, for which `Timing.turning` is."""
SPEED_SHARE = 0.84
"""A step of δ that the model lacks puts the observer's speed off by up to this share of δ/ω: with three poles at ω the
error is δ·(t + ω·t²)·exp(-ω·t), greatest at ω·t = (1 + √5)/2."""


SUDDEN_SHARE, SUDDEN_SIGMAS = 0.5, 6.0
"""Share of a joint's fastest speed by which none changes within a cycle, and deviations of its analogue noise."""
STAYED = 0.5, 2.0
"""Between these shares of a sudden change it has stayed: a struck joint goes on, and is four times as far by then."""


class TachlessWitness(SensorLess):
    """Residual of one joint: the angle off the observer's, which follows it at 12 rad/s.

    A code that does not change is judged by the model's travel meanwhile, from the speed and with the
    acceleration bias estimated when it last changed, and as far as the highest friction of the box would let it: of a
    joint so slow that this stops it within a step, and for a while after, until the bias has learned the friction.
    So long, the observer's speed is in doubt by what that friction makes of it; the readings' own speed, of a fine
    sensor, by much less. A joint that its readings have just shown to accelerate as nobody foresaw may do so again.
    """

    __slots__ = (
        "_doubt_rad_s", "_gone_bias", "_gone_rad", "_gone_rad_s", "_has_moved", "_last_off_rad", "_last_rad",
        "_lasting_cycles", "_lasting_rad_s2", "_learning", "_least_rad", "_read", "_rubbed_rad_s", "_rubs_rad_s2",
        "_shaken_until", "_slow_at", "_slow_rad_s", "_stood_cycles", "_struck_cycles", "_sudden_cycles",
        "_sudden_limit", "_sudden_rad", "_travel_rad", "_turned_rad_s", "_unmodelled", "_way", "_x_code",
    )  # fmt: skip

    def __init__(self, nominal: JointNominal, thresholds: Thresholds, timing: Timing, report: Report) -> None:
        super().__init__(nominal, thresholds, timing, report)
        self._unmodelled = UNLEARNED_SHARE * unmodelled_rad_s2(nominal)
        _, mobility = nominal.mobility_per_kg_m2
        self._learning = round(LEARNS_LONGER * timing.turning)
        self._rubs_rad_s2 = (COULOMB[1] - 1.0) * nominal.coulomb_nm * mobility
        self._slow_rad_s = math.sqrt(2.0 * self._rubs_rad_s2 * self._position_lsb)
        self._doubt_rad_s = SPEED_SHARE * self._rubs_rad_s2 / blind_pole_rad_s(self._period_s)
        self._struck_cycles = max(round(STRUCK_S / timing.period_s), 2)
        self._read = ReadSpeed(nominal.position.noise, self._rubs_rad_s2, self._period_s)
        self._least_rad = least_travel_rad(nominal)
        self._turned_rad_s = 2.0 * self._rubs_rad_s2 * self._period_s
        self._sudden_limit = sudden_rad(nominal, self._period_s)
        self._lasting_rad_s2 = thresholds.lasting
        self.start(0.0)

    def start(self, position_rad: float) -> None:
        """At rest at a measured angle."""
        super().start(position_rad)
        self.mode = Mode.NO_TACHOMETER
        self._blind.start(position_rad, 0.0, 0.0)
        self._read.start(position_rad, 0.0)
        self._gone_rad = self._gone_rad_s = self._gone_bias = self._rubbed_rad_s = self._way = 0.0
        self._travel_rad = self._thresholds.stuck_travel
        self._x_code, self._stood_cycles, self._lasting_cycles = -1, 0, 0
        self._slow_at = 0
        self._sudden_rad, self._sudden_cycles = 0.0, 0
        self._has_moved, self._last_rad, self._last_off_rad, self._shaken_until = False, position_rad, 0.0, 0

    def strikes(self, position_rad: float, side: int) -> bool:
        """Whether it is at its stop on this side (-1 or 1) and moves into it; not if only its sensor says so."""
        is_near = abs(position_rad - self._blind.position_rad) <= BLIND_FACTOR * self._limits.jump
        return is_near and self.cycles >= self._shaken_until and super().strikes(position_rad, side)

    def shake(self) -> None:
        """A joint of its robot strikes an end stop: for a while its speed is the difference of two angles."""
        super().shake()
        self._shaken_until = self.cycles + self._struck_cycles

    def step(self, x: float, v: float, acceleration: float, x_code: int, v_code: int) -> bool:
        """Take one cycle: angle, the speed that the loop's observer gives, the model's acceleration since the last.

        Returns True where `position_rad` and `velocity_rad_s` are to be taken instead.
        """
        cycles = self.cycles = self.cycles + 1
        self.model_rad_s += self._period_s * acceleration
        blind = self._blind
        blind.predict(acceleration)
        if self.mode is _BLIND:
            is_astray = True
        else:
            off = x - blind.position_rad
            sudden = x - self._last_rad - self._period_s * self.speed
            jump, sudden_limit = BLIND_FACTOR * self._limits.jump, self._sudden_limit
            is_usual = (
                -jump <= off <= jump
                and -sudden_limit <= sudden <= sudden_limit
                and cycles > self._shaken_until
                and cycles > self._timing.calm
                and cycles >= self._calm_at
                and not (self._sudden_cycles or self._astray_cycles)
            )  # long turning, where it should be, and nothing is pending
            is_astray = not (is_usual or self._begins_anew(x, off)) and self._is_astray(off, sudden, x_code)
            self._last_off_rad = off
        if not is_astray:
            blind.correct(x)
        self._last_rad = x
        speed = self.speed = blind.velocity_rad_s
        bias = self.bias = blind.bias
        if -self._slow_rad_s < speed < self._slow_rad_s:
            self._slow_at = cycles
        self._judge_code(x_code, acceleration)
        if self._lasting_cycles or not -self._lasting_rad_s2 <= bias <= self._lasting_rad_s2:
            self._judge_bias()
        return is_astray and self._substitute(blind.position_rad, self.speed)

    @property
    def is_shaken(self) -> bool:
        """Whether it has just begun, or been struck, so that it may go on in any way."""
        return self.cycles < self._calm_at or self.cycles < self._shaken_until

    def accuse_standing(self, detail: str) -> None:
        """The joint turns by all that is known, and its code stands."""
        if self.mode is not _BLIND and self._report("potentiometer-stuck", detail, Reaction.OFF):
            self.mode = _BLIND

    def accuse_code(self) -> bool:
        """There is no tachometer whose code could stand."""
        return False

    def glimpse(self, x: float, v: float, acceleration: float, x_code: int, v_code: int, is_gap: bool) -> bool:
        """As `step`, but when this was measured is known badly."""
        self._stood_cycles = self._lasting_cycles = 0
        self._x_code = -1
        self._read.start(x, self.model_rad_s)
        if is_gap and self.mode is not _BLIND:
            self._blind.start(x, self.speed, self.bias)
        self._calm_at = max(self._calm_at, self.cycles + self._timing.blurred)
        return self.step(x, v, acceleration, x_code, v_code)

    @property
    def is_elastic(self) -> bool:
        """Nobody can tell whether its wire is elastic."""
        return True

    def settle(self, bias_rad_s2: float) -> None:
        """There is nothing to settle: the observer learns the model's error by itself."""

    def _begins_anew(self, x: float, off: float) -> bool:
        """Whether the joint moves as nothing that is known explains, and may do so: the observer begins again.

        It has just struck a stop; or it moved when the run began: its first reading is off, or its readings leave the
        model one by one, which no jump does.
        """
        last_off = self._last_off_rad
        if self.cycles > self._shaken_until:
            if self._has_moved or self.cycles > self._timing.calm:
                return False
            moved = self._thresholds.moved
            is_first = self.cycles == 1
            if abs(off) <= moved or not (is_first or (off * last_off > 0.0 and abs(last_off) > 0.5 * abs(off))):
                return False
            self._has_moved = True
        self._blind.start_moving(x, (x - self._last_rad) / self._period_s)
        return True

    def _is_astray(self, off: float, sudden: float, x_code: int) -> bool:
        if self._is_sudden(off, sudden, x_code):
            return True
        factor = BLIND_FACTOR if self.cycles >= self._calm_at else 2.0 * BLIND_FACTOR
        if abs(off) <= factor * self._limits.jump:
            if self._astray_cycles:
                self._report("potentiometer-spike", "one reading rejected", None)
            self._astray_cycles = 0
            return False
        self._astray_cycles += 1
        if self._astray_cycles >= PERSISTENT_CYCLES:
            self._accuse_jump(x_code, f"{off / self._position_lsb:+.1f} LSB from the model, and no tachometer")
        return True

    def _is_sudden(self, off: float, sudden: float, x_code: int) -> bool:
        """Whether the angle has just changed as no joint can in a cycle, and what comes of that is not known yet.

        A joint that was struck goes on; a reading that was wrong comes back; counts that were lost stay so.
        """
        if not self._sudden_cycles:
            if -self._sudden_limit <= sudden <= self._sudden_limit or self.is_shaken:
                return False
            self._sudden_rad = sudden
        self._sudden_cycles += 1
        if self._sudden_cycles < PERSISTENT_CYCLES:
            return True
        gone, self._sudden_cycles = off / self._sudden_rad, 0
        if gone < STAYED[0]:
            self._report("potentiometer-spike", "readings rejected", None)
        elif gone < STAYED[1]:
            detail = f"{self._sudden_rad / self._position_lsb:+.1f} LSB in one cycle, and no tachometer"
            return self._accuse_jump(x_code, detail)
        return False

    def _accuse_jump(self, x_code: int, detail: str) -> bool:
        """The angle is where the joint is not; whether it is not followed any more."""
        at_end = x_code in self._angle_ends
        accused = self._report("potentiometer-range" if at_end else "potentiometer-jump", detail, Reaction.OFF)
        if accused:
            self.mode = _BLIND
        return accused

    def _judge_code(self, x_code: int, acceleration: float) -> None:
        """Whether the model moves while the code does not."""
        read, left = self._read, self._slow_at + self._learning - self.cycles
        unlearned = left / self._learning if left > 0 else 0.0
        rubs_rad_s2 = unlearned * self._rubs_rad_s2
        read.take(self._last_rad, self.model_rad_s, self.bias, rubs_rad_s2)
        stood_cycles = self._stood_cycles
        if x_code != self._x_code or stood_cycles > self._timing.agree:
            self._x_code, self._stood_cycles = x_code, 0
            self._gone_rad, self._gone_bias = 0.0, self.bias
            if read.doubt_rad_s < self._doubt_rad_s:
                self._gone_rad_s = _surely(read.speed, read.doubt_rad_s)
            else:
                self._gone_rad_s = _surely(self.speed, unlearned * self._doubt_rad_s)
            self._way = self._gone_rad_s
            self._rubbed_rad_s = max(rubs_rad_s2, read.unforeseen_rad_s2) * self._period_s
            is_foreseen = read.unforeseen_rad_s2 <= self._rubs_rad_s2
            self._travel_rad = self._least_rad if is_foreseen else self._thresholds.stuck_travel
            return
        stood_cycles = self._stood_cycles = stood_cycles + 1
        gone_rad_s = self._gone_rad_s + self._period_s * (acceleration + self._gone_bias)
        doubt = self._rubbed_rad_s
        if gone_rad_s * self._way <= 0.0 and doubt < self._turned_rad_s:  # it turns
            doubt = self._turned_rad_s
        self._gone_rad_s = gone_rad_s = _surely(gone_rad_s, doubt)
        gone_rad = self._gone_rad = self._gone_rad + self._period_s * gone_rad_s
        if stood_cycles < STUCK_CYCLES or self.cycles < self._calm_at or self.mode is _BLIND:
            return
        least = STUCK_FACTOR * self._travel_rad
        if -least <= gone_rad <= least:
            return
        stood_s = stood_cycles * self._period_s
        timing_rad = STUCK_TRAVEL * TIMING_SHARE * self._period_s * abs(gone_rad_s)
        limit = STUCK_FACTOR * max(self._travel_rad, timing_rad) + 0.5 * self._unmodelled * stood_s**2
        if abs(gone_rad) > limit:
            detail = f"code {x_code} while the model turned {gone_rad / self._position_lsb:.1f} LSB"
            self.accuse_standing(detail)

    def _judge_bias(self) -> None:
        """Whether the acceleration is beyond any payload: a jam, a braking drive."""
        beyond = abs(self.bias) > self._lasting_rad_s2 and self.cycles > 2 * self._timing.calm
        self._lasting_cycles = self._lasting_cycles + 1 if beyond else 0
        if self._lasting_cycles > self._timing.lasting:
            detail = f"{self.bias:+.0f} rad/s2 beyond the model, more than any payload, and lasting"
            self._report("acceleration-mismatch", detail, Reaction.OFF)


def least_travel_rad(joint: JointNominal) -> float:
    """How far a joint goes at least while its code stands: a step, and what noise hides of it."""
    return STUCK_TRAVEL * joint.position.noise / REFERENCE_NOISE


def sudden_rad(joint: JointNominal, period_s: float) -> float:
    """The most that two readings, a cycle apart, differ by beyond what the joint has turned by its speed."""
    position = joint.position
    analogue = math.sqrt(max(position.noise**2 - (ROUNDING_LSB * position.step) ** 2, 0.0))
    return position.step + SUDDEN_SIGMAS * math.sqrt(2.0) * analogue + SUDDEN_SHARE * joint.fastest_rad_s * period_s


def _surely(speed: float, doubt: float) -> float:
    """What of a speed is left by its doubt."""
    if speed > doubt:
        return speed - doubt
    if speed < -doubt:
        return speed + doubt
    return math.copysign(0.0, speed)
