"""What all kinds of sensor have in common: what they measure, and how a code reads in its unit.

A kind belongs to a file of its own. Noise, offsets and faults of the true sensor belong to the emulator.
"""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Literal

from ...cards.kind import Wire
from ..table import NonNegative, Positive, Table


class Quantity(StrEnum):
    """What can be measured at a joint."""

    POSITION = "position"
    VELOCITY = "velocity"
    CURRENT = "current"


@dataclass(frozen=True, slots=True)
class SensorScale:
    """Turns a code into its physical quantity: value = (code - zero) x step, in rad, rad/s or A.

    `step` is negative where the quantity falls as the code rises.
    """

    zero: float
    step: float

    def __call__(self, code: float) -> float:
        """The quantity at `code`."""
        return (code - self.zero) * self.step

    @property
    def lsb(self) -> float:
        """One step of the code, without sign: rad, rad/s or A."""
        return abs(self.step)


@dataclass(frozen=True, slots=True)
class Fitting:
    """How a sensor is fitted: what a reading of its card counts, and the joint that it sits at."""

    bits: int
    """Of the card's code."""
    edges_per_period: int = 1
    """Of the two tracks of an encoder, that a counter counts."""
    gear_ratio: float = 1.0
    home_rad: float = 0.0
    """Where the joint is when its card is switched on."""


class Sensor(Table):
    """One sensor of a joint, as the cell describes it. A kind sets the class variables and gives its scale."""

    kind: ClassVar[str]
    """Its table in the file, and the second half of its signal: `[robot.joint.sensors.<kind>]`, `<joint>.<kind>`."""
    title: ClassVar[str]
    quantity: ClassVar[Quantity]
    wire: ClassVar[Wire]
    """What kind of card channel takes it."""
    is_on_motor: ClassVar[bool] = False
    """Whether it sits on the motor's side of the drive wire."""
    takes_magnitude: ClassVar[bool] = False
    """Whether it shows the magnitude alone."""

    @abstractmethod
    def scale(self, fitting: Fitting) -> SensorScale:
        """Nominal scale of its codes."""

    @abstractmethod
    def seen(self) -> tuple[float, float]:
        """The least and the greatest value that its codes can show, in rad, rad/s or A."""

    def problems(self) -> Iterator[str]:
        """What of its parameters does not fit together: "key = value: what would be right"."""
        yield from ()


class AnalogueSensor(Sensor):
    """A sensor that gives a voltage, 0 to `full_scale_v`, for an ADC whose reference is that full scale."""

    wire: ClassVar[Wire] = Wire.VOLTAGE

    full_scale_v: Positive
    noise_lsb: NonNegative
    """Standard deviation, in steps of the ADC that it is wired to."""

    @property
    @abstractmethod
    def nominal_zero_v(self) -> float:
        """Volts at 0 rad, rad/s or A."""

    @property
    @abstractmethod
    def volts_per_unit(self) -> float:
        """Volts per rad, rad/s or A; negative for `sign` = -1."""

    def seen(self) -> tuple[float, float]:
        """The values at both ends of the voltage's range, the lesser one first."""
        ends = -self.nominal_zero_v / self.volts_per_unit, self._above_zero_v / self.volts_per_unit
        return min(ends), max(ends)

    @property
    def _above_zero_v(self) -> float:
        return self.full_scale_v - self.nominal_zero_v


def highest_code(bits: int) -> int:
    """The full-scale code of a converter of `bits` bits."""
    return (1 << bits) - 1


Sign = Literal[1, -1]
"""Which way a sensor is mounted: -1 where its reading falls as the joint turns counter-clockwise."""
