"""Faults of wires: to the sensors, to the motors, and of the supplies.

Nobody gives the circuit around the converter's pins. Assumed for every sensor: an output resistance of
`SOURCE_OHM`, and at the pin `PIN_OHM` to ground with `PIN_F` beside it. Leakage and a short inside a motor's lead have
no place in the model of the drive, and are not declared there.
"""

import dataclasses
import math
from dataclasses import dataclass
from random import Random
from typing import ClassVar

from ...robot.truth import JointTruth
from ..declaration import Context, Family, JointFault, SignalFault, TapKind
from ..parameters import of_tap, parameter

SOURCE_OHM = 2500.0
"""Assumed: the wiper of a 10 kohm potentiometer in the middle, 5 kohm to either side of it."""
PIN_OHM = 100e3
"""Assumed: what pulls the pin to ground. The ADC0809's own input takes a few microamperes at most (data sheet)."""
PIN_F = 100e-9
"""Assumed: a filter at the pin."""
OPEN_OHM = 1e9
"""A lead that conducts no more: nanoamperes at 15 V."""

SENSOR, SUPPLY, MOTOR = (frozenset({kind}) for kind in (TapKind.SENSOR, TapKind.SUPPLY, TapKind.MOTOR))
_PER_NS = 1e-9


def _floating(volts: float, elapsed_ns: int, time_constant_s: float) -> float:
    """A pin that nothing drives any more, `elapsed_ns` after it had `volts`."""
    return volts * math.exp(-elapsed_ns * _PER_NS / time_constant_s) if time_constant_s else 0.0


class _Contact:
    """A contact that opens and closes at random, open at first; both times are distributed exponentially."""

    def __init__(self, duty: float, frequency_hz: float, context: Context) -> None:
        self._mean_s = {True: duty / frequency_hz, False: (1.0 - duty) / frequency_hz}
        self._random: Random = context.random
        self._is_open, self._until_ns = False, context.now_ns

    def is_open(self, now_ns: int) -> bool:
        """How it is at that time, which never goes back."""
        while now_ns >= self._until_ns:
            self._is_open = not self._is_open
            self._until_ns += 1 + round(self._random.expovariate(1.0 / self._mean_s[self._is_open]) / _PER_NS)
        return self._is_open


@dataclass
class SensorOpenLoad(SignalFault, name="open-load", family=Family.WIRING, acts_on=SENSOR):
    """The wire is broken: the pin is pulled to ground."""

    time_constant: float = parameter("of the way to ground: the filter at the pin", "s", PIN_OHM * PIN_F, 0.0, 10.0)

    def begin(self, context: Context) -> None:
        """It breaks here."""
        self._begun_ns, self._volts = context.now_ns, -1.0

    def apply(self, value: float, now_ns: int) -> float:
        """What the filter still holds."""
        if self._volts < 0.0:
            self._volts = value
        return _floating(self._volts, now_ns - self._begun_ns, self.time_constant)


@dataclass
class ShortToGround(SignalFault, name="short-to-ground", family=Family.WIRING, acts_on=SENSOR):
    """The wire touches ground."""

    def begin(self, context: Context) -> None:
        """Ground is the lower end of the range."""
        self._volts = context.tap.low

    def apply(self, value: float, now_ns: int) -> float:
        """Ground."""
        return self._volts


@dataclass
class ShortToSupply(SignalFault, name="short-to-supply", family=Family.WIRING, acts_on=SENSOR):
    """The wire touches the sensors' supply."""

    def begin(self, context: Context) -> None:
        """The sensors' supply is the upper end of the range."""
        self._volts = context.tap.high

    def apply(self, value: float, now_ns: int) -> float:
        """The supply."""
        return self._volts


@dataclass
class SensorInLineResistance(SignalFault, name="in-line-resistance", family=Family.WIRING, acts_on=SENSOR):
    """A corroded contact: resistance in the wire divides the voltage with the 100 kohm at the pin."""

    resistance: float = parameter("in the wire", "ohm", 10e3, 0.0, 10e6)

    def apply(self, value: float, now_ns: int) -> float:
        """The voltage divider."""
        return value * PIN_OHM / (PIN_OHM + self.resistance)


@dataclass
class Leakage(SignalFault, name="leakage", family=Family.WIRING, acts_on=SENSOR):
    """Moisture or damaged insulation: the wire leaks to ground, against the 2.5 kohm of the sensor."""

    resistance: float = parameter("from the wire to ground", "ohm", 10e3, 1.0, 10e6)

    def apply(self, value: float, now_ns: int) -> float:
        """The voltage divider."""
        return value * self.resistance / (self.resistance + SOURCE_OHM)


@dataclass
class SensorLooseContact(SignalFault, name="loose-contact", family=Family.WIRING, acts_on=SENSOR):
    """The wire breaks and makes contact at random; meanwhile the pin is pulled to ground."""

    duty: float = parameter("mean share of the time without contact", "", 0.5, 0.01, 0.99)
    frequency: float = parameter("mean number of breaks a second", "Hz", 10.0, 0.01, 1000.0)

    def begin(self, context: Context) -> None:
        """It breaks here for the first time."""
        self._contact = _Contact(self.duty, self.frequency, context)
        self._begun_ns, self._volts = context.now_ns, -1.0

    def apply(self, value: float, now_ns: int) -> float:
        """The voltage, or what the filter at the pin still holds of it."""
        if self._volts < 0.0 or not self._contact.is_open(now_ns):
            self._begun_ns, self._volts = now_ns, value
        return _floating(self._volts, now_ns - self._begun_ns, PIN_OHM * PIN_F)


@dataclass
class GroundShift(SignalFault, name="ground-shift", family=Family.WIRING, acts_on=SENSOR):
    """The sensor's ground lies above the converter's."""

    shift: float = of_tap("by how much; below, where negative", 0.1, -1.0, 1.0)

    def apply(self, value: float, now_ns: int) -> float:
        """The sum."""
        return value + self.shift


class _SensorSupply(SignalFault):
    ratio: float

    def apply(self, value: float, now_ns: int) -> float:
        """The sensors are ratiometric, the converter's reference is its own."""
        return value * self.ratio


@dataclass
class SensorUndervoltage(_SensorSupply, name="supply-undervoltage", family=Family.WIRING, acts_on=SENSOR):
    """The sensor's supply is too low, and its voltage in proportion."""

    ratio: float = parameter("supply as a multiple of what it should be", "", 0.8, 0.0, 1.0)


@dataclass
class SensorOvervoltage(_SensorSupply, name="supply-overvoltage", family=Family.WIRING, acts_on=SENSOR):
    """The sensor's supply is too high, and its voltage in proportion."""

    ratio: float = parameter("supply as a multiple of what it should be", "", 1.2, 1.0, 2.0)


class _AmplifierSupply(JointFault):
    ratio: float

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """Another supply voltage."""
        return dataclasses.replace(joint, supply_v=joint.supply_v * self.ratio)


@dataclass
class AmplifierUndervoltage(_AmplifierSupply, name="supply-undervoltage", family=Family.WIRING, acts_on=SUPPLY):
    """The supply is too low: less current at speed."""

    ratio: float = parameter("supply as a multiple of what it should be", "", 0.5, 0.0, 1.0)


@dataclass
class AmplifierOvervoltage(_AmplifierSupply, name="supply-overvoltage", family=Family.WIRING, acts_on=SUPPLY):
    """The supply is too high: more current at speed."""

    ratio: float = parameter("supply as a multiple of what it should be", "", 1.5, 1.0, 3.0)


def with_resistance(joint: JointTruth, in_line_ohm: float) -> JointTruth:
    """The joint's motor with `in_line_ohm` in series."""
    return dataclasses.replace(joint, winding_ohm=joint.winding_ohm + in_line_ohm)


@dataclass
class MotorOpenLoad(JointFault, name="open-load", family=Family.WIRING, acts_on=MOTOR):
    """A lead of the motor is broken: no current."""

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """No way for a current."""
        return with_resistance(joint, OPEN_OHM)


@dataclass
class MotorInLineResistance(JointFault, name="in-line-resistance", family=Family.WIRING, acts_on=MOTOR):
    """Resistance in a lead of the motor: the supply drives less current, and it follows faster."""

    resistance: float = parameter("in the lead", "ohm", 20.0, 0.0, 10e6)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """The winding and the lead in series."""
        return with_resistance(joint, self.resistance)


@dataclass
class MotorLooseContact(JointFault, name="loose-contact", family=Family.WIRING, acts_on=MOTOR):
    """A lead of the motor breaks and makes contact at random; meanwhile there is no current."""

    varies: ClassVar[bool] = True
    duty: float = parameter("mean share of the time without contact", "", 0.5, 0.01, 0.99)
    frequency: float = parameter("mean number of breaks a second", "Hz", 10.0, 0.01, 1000.0)

    def begin(self, context: Context) -> None:
        """It breaks here for the first time."""
        self._contact = _Contact(self.duty, self.frequency, context)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """The line unchanged, or open."""
        return with_resistance(joint, OPEN_OHM) if self._contact.is_open(now_ns) else joint
