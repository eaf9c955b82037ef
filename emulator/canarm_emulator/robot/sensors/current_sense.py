"""The true current sense: the magnitude |i|, since it sits at the one-way stage, before the bridge."""

from dataclasses import dataclass

from .base import AnalogueSource, Moment, analogue_kind


@dataclass(frozen=True, slots=True)
class CurrentSenseSource(AnalogueSource):
    """A voltage proportional to the magnitude of the motor's current."""

    def read(self, moment: Moment, within: float, deviate: float) -> float:
        """The voltage at the pin."""
        joint = self.joint_index
        current_a = moment.drives[joint].current_after(within * moment.step_s, moment.old_current[joint])
        return self.volts(abs(current_a), deviate)


CURRENT_SENSE = analogue_kind("current_sense", CurrentSenseSource)
