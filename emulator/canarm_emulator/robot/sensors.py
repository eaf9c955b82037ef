"""From true motion and current to volts at the ADC's pins: potentiometer, tachometer, current sense, and their noise.

Conversion to a code, and its errors, belong to the ADC card.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from canarm_protocol.cell.model import Joint, Quantity

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


def source(joint_index: int, joint: Joint, truth: JointTruth, quantity: Quantity) -> Source:
    """The sensor that measures `quantity` at `joint`; true offsets are part of its zero.

    The current sense measures the magnitude |i|: it sits at the one-way D669 stage, before the bridge.
    The noise is counted in steps of an 8-bit reading, full_scale_v/255.
    Raises `EmulatorError` for a quantity that no sensor measures.
    """
    sensors = joint.sensors
    zero_v = 0.0
    if quantity == Quantity.POTENTIOMETER:
        gain = sensors.full_scale_v / math.radians(sensors.potentiometer_range_deg)
        zero_v = sensors.potentiometer_zero_v + gain * math.radians(truth.potentiometer_offset_deg)
    elif quantity == Quantity.TACHOMETER:
        gain = (sensors.full_scale_v - sensors.tachometer_zero_v) / sensors.tachometer_full_scale_rad_s
        zero_v = sensors.tachometer_zero_v + gain * truth.tachometer_offset_rad_s
    elif quantity == Quantity.CURRENT_SENSE:
        gain = sensors.full_scale_v / sensors.current_sense_full_scale_a
    else:
        measured = ", ".join((Quantity.POTENTIOMETER, Quantity.TACHOMETER, Quantity.CURRENT_SENSE))
        raise EmulatorError(f"{joint.name}.{quantity}: no sensor measures it; measured are {measured}")
    noise_v = truth.noise_lsb * sensors.full_scale_v / 255
    return Source(joint_index, Quantity(quantity), gain, zero_v, noise_v, sensors.full_scale_v)


def normal_deviates(seed: int) -> Iterator[float]:
    """Standard normal deviates from numpy's PCG64, for ever; the same `seed` gives the same bits."""
    generator = np.random.Generator(np.random.PCG64(seed))
    while True:
        yield from generator.standard_normal(_BLOCK).tolist()
