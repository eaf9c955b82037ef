"""The true encoder: the angle of its shaft, which a counter card turns into counts from where it is switched on."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from canarm_protocol.cell.sensing import WiredSensor
from canarm_protocol.cell.sensors.encoder import Encoder

from .base import Moment, SensorKind, Source


@dataclass(frozen=True, slots=True)
class EncoderSource(Source):
    """The unwrapped angle of the shaft, rad: `turns` per turn of the joint, negative if it is mounted in reverse."""

    turns: float
    is_on_motor: bool

    def read(self, moment: Moment, within: float, deviate: float) -> float:
        """The angle; counting has no noise."""
        dof = moment.motor_dof[self.joint_index] if self.is_on_motor else self.joint_index
        old_rad = moment.old_angle[dof]
        return self.turns * (old_rad + within * (moment.angle[dof] - old_rad))


def _make(wired: WiredSensor, true: Mapping[str, float]) -> Source:
    sensor = wired.sensor
    assert isinstance(sensor, Encoder)
    is_on_motor = sensor.shaft == "motor"
    turns = sensor.sign * (wired.gear_ratio if is_on_motor else 1.0)
    return EncoderSource(wired.joint, sensor.quantity, math.inf, turns, is_on_motor)


ENCODER = SensorKind(_make)
