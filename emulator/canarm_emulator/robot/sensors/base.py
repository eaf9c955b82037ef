"""What all true sensors have in common: sampling within a step of integration, and their output.

Conversion to a code, and its errors, belong to the cards. Particular kinds of sensor never enter.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from canarm_protocol.cards.kind import highest_code
from canarm_protocol.cell.sensing import WiredSensor
from canarm_protocol.cell.sensors import AnalogueSensor, Quantity, Sensor

from ...signals import Distortion
from ..stages import Stage
from ..truth_keys import Parameter


class Winding(Protocol):
    """A drive as a current sense sees it."""

    current_a: float

    def current_after(self, elapsed_s: float, old_current_a: float) -> float:
        """Signed current `elapsed_s` into the last step, which began at `old_current_a`."""


class Moment:
    """One step of integration as sensors see it: motion and current at its beginning and at its end.

    Angles and speeds are those of the joints, then of the motors on elastic wires; `motor_dof` is the index of each
    joint's motor. Within the step they are interpolated linearly (an error of 3e-6 rad at 650 µs and 50 rad/s²), the
    current exponentially, as it is integrated.
    """

    __slots__ = ("angle", "drives", "motor_dof", "old_angle", "old_current", "old_speed", "speed", "step_s")

    def __init__(self, drives: Sequence[Winding], motor_dof: Sequence[int]) -> None:
        self.drives, self.motor_dof = drives, motor_dof
        self.old_angle: Sequence[float] = ()
        self.old_speed: Sequence[float] = ()
        self.old_current: Sequence[float] = ()
        self.angle: Sequence[float] = ()
        self.speed: Sequence[float] = ()
        self.step_s = 0.0


@dataclass(frozen=True, slots=True)
class Source(ABC):
    """The true sensor of a joint. On the wire to its card it gives 0 to `highest`, in volts or counts."""

    joint_index: int
    quantity: Quantity
    highest: float

    @abstractmethod
    def read(self, moment: Moment, within: float, deviate: float) -> float:
        """Its output at `within` (0 to 1) of the step, with a standard normal `deviate` as noise."""


@dataclass(frozen=True, slots=True)
class AnalogueSource(Source):
    """A wire to an ADC pin: volts = zero_v + gain · (rad, rad/s or A), limited to 0..highest, noise included."""

    gain: float
    zero_v: float
    noise_v: float

    def volts(self, value: float, deviate: float) -> float:
        """Voltage for `value` in the quantity's unit, with a standard normal `deviate` as noise."""
        volts = self.zero_v + self.gain * value + self.noise_v * deviate
        if volts < 0.0:
            return 0.0
        return volts if volts < self.highest else self.highest


@dataclass(frozen=True, slots=True)
class DistortedSource(Source):
    """A faulty wire: the sensor's output is distorted on its way."""

    source: Source
    distortion: Distortion

    @classmethod
    def of(cls, source: Source, distortion: Distortion) -> "DistortedSource":
        """`source`, broken."""
        return cls(source.joint_index, source.quantity, source.highest, source, distortion)

    def read(self, moment: Moment, within: float, deviate: float) -> float:
        """The distorted output, limited to its range."""
        return min(max(self.distortion(self.source.read(moment, within, deviate)), 0.0), self.highest)


@dataclass(frozen=True, slots=True)
class SensorKind:
    """A kind of sensor in the true robot: how it is made, and its keys of `--truth`."""

    make: Callable[[WiredSensor, Mapping[str, float]], Source]
    """The sensor at a channel, from the joint's true values by the `field` of each parameter."""
    truth: tuple[Parameter, ...] = ()
    """Keys whose nominal value is 0."""
    noise: Parameter | None = None
    """Key whose nominal value is the sensor's `noise_lsb`."""

    stage: Callable[[Sensor], Stage | None] = lambda sensor: None
    """Where faults act on its output; None if they act on its card's code only."""

    def nominal(self, sensor: Sensor) -> dict[str, float]:
        """The true values of a sound `sensor`, by field."""
        values = {row.field: 0.0 for row in self.truth}
        if self.noise is not None and isinstance(sensor, AnalogueSensor):
            values[self.noise.field] = sensor.noise_lsb
        return values

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All its keys."""
        return self.truth if self.noise is None else (*self.truth, self.noise)


def analogue_kind(
    name: str, of: Callable[..., AnalogueSource], offset: Parameter | None = None, per_unit: float = 1.0
) -> SensorKind:
    """A kind that gives volts with the nominal gain, noise and, if it has one, an `offset` in units of `per_unit`.

    The noise is in steps of the sensor's converter.
    """
    noise = f"{name}_noise_lsb"

    def make(wired: WiredSensor, true: Mapping[str, float]) -> Source:
        sensor = wired.sensor
        assert isinstance(sensor, AnalogueSensor)
        gain, full_scale_v = sensor.volts_per_unit, sensor.full_scale_v
        zero_v = sensor.nominal_zero_v + (gain * (true[offset.field] * per_unit) if offset else 0.0)
        noise_v = true[noise] * full_scale_v / highest_code(wired.bits)
        return of(wired.joint, sensor.quantity, full_scale_v, gain, zero_v, noise_v)

    row = Parameter(noise, noise, "LSB", "noise of this sensor alone, standard deviation", 0.0, 255.0)
    return SensorKind(make, () if offset is None else (offset,), row, _pin)


def _pin(sensor: Sensor) -> Stage | None:
    assert isinstance(sensor, AnalogueSensor)
    return Stage(sensor.kind, f"{sensor.title}'s voltage at the ADC's pin", "V", sensor.full_scale_v)
