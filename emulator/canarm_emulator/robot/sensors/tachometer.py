"""The true tachometer: on the motor's shaft, with an offset of its zero."""

from dataclasses import dataclass

from ..truth_keys import Parameter
from .base import AnalogueSource, Moment, analogue_kind

_OFFSET = Parameter("tachometer_offset", "tachometer_offset_rad_s", "rad/s", "added to the speed read", -100.0, 100.0)


@dataclass(frozen=True, slots=True)
class TachometerSource(AnalogueSource):
    """Volts of the motor's speed, seen at the joint."""

    def read(self, moment: Moment, within: float, deviate: float) -> float:
        """The voltage at the pin."""
        dof = moment.motor_dof[self.joint_index]
        old_rad_s = moment.old_speed[dof]
        return self.volts(old_rad_s + within * (moment.speed[dof] - old_rad_s), deviate)


TACHOMETER = analogue_kind("tachometer", TachometerSource, _OFFSET)
