"""What all kinds of sensor have in common: the quantity that they measure, and the scale of their codes.

Each kind has its own file. Noise, offsets and faults of the true sensor belong to the emulator.
"""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

from ...cards.kind import Wire
from ..table import NonNegative, Positive, Sign, Table


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
    """How a sensor is fitted: what its card's codes count, and the joint at which it sits."""

    bits: int
    """Bits of the card's code."""
    edges_per_period: int = 1
    """Edges of an encoder's two tracks that the counter counts in each period."""
    gear_ratio: float = 1.0
    home_rad: float = 0.0
    """Angle of the joint when its card is switched on."""


class Sensor(Table):
    """One sensor of a joint, as the cell describes it. A kind sets the class variables and gives its scale."""

    kind: ClassVar[str]
    """Name of its table, `[robot.joint.sensors.<kind>]`, and of its signal, `<joint>.<kind>`."""
    title: ClassVar[str]
    quantity: ClassVar[Quantity]
    wire: ClassVar[Wire]
    """The kind of card channel that takes it."""
    is_on_motor: ClassVar[bool] = False
    """Whether it sits on the motor's side of the drive wire."""
    takes_magnitude: ClassVar[bool] = False
    """Whether it shows the magnitude only."""

    @abstractmethod
    def scale(self, fitting: Fitting) -> SensorScale:
        """Nominal scale of its codes."""

    @abstractmethod
    def seen(self) -> tuple[float, float]:
        """The lowest and the highest value that its codes can show, in rad, rad/s or A."""

    @property
    def is_reversed(self) -> bool:
        """Whether it is mounted so that its reading falls where that of others rises."""
        return False

    def problems(self) -> Iterator[str]:
        """Problems of its parameters, as "key = value: what would be right"."""
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
        """Volts per rad, rad/s or A; negative where the voltage falls as the quantity rises."""

    @property
    def is_reversed(self) -> bool:
        """Whether its voltage falls as the quantity rises."""
        return self.volts_per_unit < 0.0

    def seen(self) -> tuple[float, float]:
        """The values at both ends of the voltage range, the lower one first."""
        ends = -self.nominal_zero_v / self.volts_per_unit, self._above_zero_v / self.volts_per_unit
        return min(ends), max(ends)

    @property
    def _above_zero_v(self) -> float:
        return self.full_scale_v - self.nominal_zero_v


def said_twice(key: str, value: float, sign: Sign) -> Iterator[str]:
    """The problem of a sensor that is turned round twice, by a negative value and by `sign`."""
    if value < 0.0 and sign < 0:
        yield f"{key} = {value:g}: turns the sensor round, and so does sign = -1; say it once"
