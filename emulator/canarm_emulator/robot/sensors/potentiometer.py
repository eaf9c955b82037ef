"""The true potentiometer: on the joint's shaft, with an offset of its zero."""

from dataclasses import dataclass

from canarm_protocol.cell.table import DEGREE

from ..truth_keys import Parameter
from .base import AnalogueSource, Moment, analogue_kind

_OFFSET = Parameter(
    "potentiometer_offset_deg", "potentiometer_offset_deg", "deg", "added to the angle read", -360.0, 360.0
)


@dataclass(frozen=True, slots=True)
class PotentiometerSource(AnalogueSource):
    """Volts of the joint's angle, whatever the drive wire does."""

    def read(self, moment: Moment, within: float, deviate: float) -> float:
        """The voltage at the pin."""
        joint = self.joint_index
        old_rad = moment.old_angle[joint]
        return self.volts(old_rad + within * (moment.angle[joint] - old_rad), deviate)


POTENTIOMETER = analogue_kind("potentiometer", PotentiometerSource, _OFFSET, DEGREE)
