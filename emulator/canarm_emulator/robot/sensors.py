"""From true motion and current to volts at the ADC's pins: potentiometer, tachometer, current sense, and their noise.

Conversion to a code, and its errors, belong to the ADC card.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from canarm_protocol.cell.sensing import WiredSensor
from canarm_protocol.cell.sensors import AnalogueSensor, Quantity
from canarm_protocol.cell.sensors.base import highest_code

from ..errors import EmulatorError
from ..signals import Distortion
from .truth import JointTruth

_BLOCK = 4096  # normal deviates drawn at once: 12 ns each instead of 1 µs


@dataclass(frozen=True, slots=True)
class Source:
    """A wire to an ADC pin: volts = zero_v + gain · (rad, rad/s or A), limited to 0..full_scale_v, noise included."""

    joint_index: int
    quantity: Quantity
    gain: float
    zero_v: float
    noise_v: float
    full_scale_v: float

    def volts(self, value: float, deviate: float) -> float:
        """Voltage for `value` in the quantity's unit, with a standard normal `deviate` as noise."""
        volts = self.zero_v + self.gain * value + self.noise_v * deviate
        if volts < 0.0:
            return 0.0
        return volts if volts < self.full_scale_v else self.full_scale_v


@dataclass(frozen=True, slots=True)
class DistortedSource(Source):
    """A wire to an ADC pin on which something is broken: what the sensor gives is changed on its way."""

    distortion: Distortion

    @classmethod
    def of(cls, source: Source, distortion: Distortion) -> Self:
        """`source`, broken."""
        return cls(
            source.joint_index,
            source.quantity,
            source.gain,
            source.zero_v,
            source.noise_v,
            source.full_scale_v,
            distortion,
        )

    def volts(self, value: float, deviate: float) -> float:
        """The voltage at the pin, 0 to full_scale_v."""
        volts = self.distortion(Source.volts(self, value, deviate))
        return min(max(volts, 0.0), self.full_scale_v)


def source(wired: WiredSensor, truth: JointTruth) -> Source:
    """The true sensor at a channel; true offsets are part of its zero.

    Raises `EmulatorError` for one that gives no voltage.
    """
    sensor = wired.sensor
    if not isinstance(sensor, AnalogueSensor):
        raise EmulatorError(f"{wired.signal}: gives no voltage; an ADC cannot read it")
    gain, full_scale_v = sensor.volts_per_unit, sensor.full_scale_v
    zero_v = sensor.nominal_zero_v + gain * _offset(sensor.quantity, truth)
    noise_v = truth.noise_of(sensor) * full_scale_v / highest_code(wired.bits)
    return Source(wired.joint, sensor.quantity, gain, zero_v, noise_v, full_scale_v)


def _offset(quantity: Quantity, truth: JointTruth) -> float:
    if quantity is Quantity.POSITION:
        return math.radians(truth.potentiometer_offset_deg)
    return truth.tachometer_offset_rad_s if quantity is Quantity.VELOCITY else 0.0


def normal_deviates(seed: int) -> Iterator[float]:
    """Standard normal deviates from numpy's PCG64, for ever; the same `seed` gives the same bits."""
    generator = np.random.Generator(np.random.PCG64(seed))
    while True:
        yield from generator.standard_normal(_BLOCK).tolist()
