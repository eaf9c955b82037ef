"""Faults of amplifiers, direction latches and motors. Leads and supplies belong to `wiring.py`."""

import dataclasses
import math
from dataclasses import dataclass

from canarm_protocol.cards.sc300 import DirectionBits

from ...robot.truth import JointTruth
from ..declaration import Context, Family, JointFault, SignalFault, TapKind
from ..parameters import of_tap, parameter
from .wiring import OPEN_OHM, with_resistance

CURRENT, LATCH, MOTOR = (frozenset({kind}) for kind in (TapKind.CURRENT, TapKind.LATCH, TapKind.MOTOR))
IDLE_CYCLES = 4
"""The bridge counts as off after this many cycles without a current command."""
COOLED = 0.5
"""A thermal switch closes again at this share of its tripping current."""


@dataclass
class CurrentLimit(SignalFault, name="current-limit", family=Family.ACTUATOR, acts_on=CURRENT):
    """Asked for more than its limit, the amplifier folds back to less, until it is asked for less than that."""

    limit: float = of_tap("the most that it gives", 0.1, 0.0, 1.0)
    fold_back: float = of_tap("what it gives when folded back", 0.05, 0.0, 1.0)

    def begin(self, context: Context) -> None:
        """Not folded back."""
        self._is_folded = False

    def apply(self, value: float, now_ns: int) -> float:
        """The current, or what the fold-back leaves of it."""
        fold_back = min(self.fold_back, self.limit)
        self._is_folded = value > (fold_back if self._is_folded else self.limit)
        return fold_back if self._is_folded else value


@dataclass
class ThermalTrip(SignalFault, name="thermal-trip", family=Family.ACTUATOR, acts_on=CURRENT):
    """A thermal switch: it opens when the current has heated it to its limit, and closes when it has cooled."""

    limit: float = of_tap("root-mean-square current at which it trips", 0.05, 0.0, 1.0)
    time_constant: float = parameter("of heating and cooling", "s", 0.5, 1e-3, 1e4)

    def begin(self, context: Context) -> None:
        """It is cold."""
        self._idle_ns = IDLE_CYCLES * context.cycle_ns
        self._last_ns, self._current_a = context.now_ns, 0.0
        self._mean_square_a2, self._is_tripped = 0.0, False

    def apply(self, value: float, now_ns: int) -> float:
        """The current, or none. Its square heats a first-order lag."""
        elapsed_ns = now_ns - self._last_ns
        flowed_a = self._current_a if elapsed_ns < self._idle_ns else 0.0
        decay = math.exp(-elapsed_ns * 1e-9 / self.time_constant)
        self._mean_square_a2 = flowed_a**2 + (self._mean_square_a2 - flowed_a**2) * decay
        threshold_a = self.limit * (COOLED if self._is_tripped else 1.0)
        self._is_tripped = self._mean_square_a2 > threshold_a**2
        self._last_ns, self._current_a = now_ns, 0.0 if self._is_tripped else value
        return self._current_a


@dataclass
class ReversedDirection(
    SignalFault, name="reversed-direction", family=Family.ACTUATOR, acts_on=LATCH, is_dangerous=True
):
    """Clockwise and counter-clockwise are swapped."""

    def apply(self, value: float, now_ns: int) -> float:
        """The other direction; off stays off."""
        if value == DirectionBits.CLOCKWISE:
            return DirectionBits.COUNTER_CLOCKWISE
        return DirectionBits.CLOCKWISE if value == DirectionBits.COUNTER_CLOCKWISE else value


@dataclass
class LatchBitStuck(SignalFault, name="latch-bit-stuck", family=Family.ACTUATOR, acts_on=LATCH, is_dangerous=True):
    """One of the two direction bits is always 0, or always 1; with both at 1 the bridge is off."""

    bit: int = parameter("0 is clockwise, 1 is counter-clockwise", "", 0, 0, 1, is_whole=True)
    value: int = parameter("what it always is", "", 1, 0, 1, is_whole=True)

    def apply(self, value: float, now_ns: int) -> float:
        """The bits with that one set or cleared."""
        mask = 1 << self.bit
        return int(value) | mask if self.value else int(value) & ~mask


@dataclass
class WindingOpen(JointFault, name="winding-open", family=Family.ACTUATOR, acts_on=MOTOR):
    """The winding is interrupted: no current, no torque."""

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """No way for a current."""
        return with_resistance(joint, OPEN_OHM)


@dataclass
class WindingShort(JointFault, name="winding-short", family=Family.ACTUATOR, acts_on=MOTOR):
    """A share of the turns is shorted: less torque per ampere, and the shorted turns brake as a generator."""

    share: float = parameter("of the turns", "", 0.3, 0.0, 0.9)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """What it means for the drive is said there."""
        return dataclasses.replace(joint, shorted_turns=max(joint.shorted_turns, self.share))


@dataclass
class LossOfTorqueConstant(JointFault, name="loss-of-torque-constant", family=Family.ACTUATOR, acts_on=MOTOR):
    """The magnets have lost strength: less torque per ampere and less back-EMF."""

    share: float = parameter("that is lost", "", 0.3, 0.0, 1.0)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """Torque constant and back-EMF constant are one number."""
        return dataclasses.replace(joint, torque_constant_nm_a=joint.torque_constant_nm_a * (1.0 - self.share))
