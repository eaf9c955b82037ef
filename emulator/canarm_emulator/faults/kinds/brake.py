"""Faults of brakes. What a share of a brake's torque is, its kind says: of a winding's contact, or of a spring."""

from dataclasses import dataclass, replace

from ...robot.truth import JointTruth
from ..declaration import Family, JointFault, TapKind
from ..parameters import parameter

BRAKE = frozenset({TapKind.BRAKE})


@dataclass
class BrakeDoesNotEngage(JointFault, name="does-not-engage", family=Family.ACTUATOR, acts_on=BRAKE):
    """The brake stays released: its contact welds, or its disc is jammed."""

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """No braking torque."""
        return replace(joint, brake_is_released=True)


@dataclass
class BrakeDrags(JointFault, name="drags", family=Family.ACTUATOR, acts_on=BRAKE):
    """The brake does not release: it has a share of its torque while the motor turns."""

    share: float = parameter("of its torque", "", 0.3, 0.0, 1.0)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """It brakes always."""
        return replace(joint, brake_drag=max(joint.brake_drag, self.share))


@dataclass
class BrakeSlips(JointFault, name="slips", family=Family.ACTUATOR, acts_on=BRAKE):
    """Worn or oiled, or its contact corroded: the engaged brake has a share of its torque alone."""

    share: float = parameter("of its torque", "", 0.3, 0.0, 1.0)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """It holds less."""
        return replace(joint, brake_slip=1.0 - (1.0 - joint.brake_slip) * self.share)
