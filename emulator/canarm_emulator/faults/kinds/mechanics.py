"""Faults of the arm itself: its load, its friction, what it runs into, and the drive wire from motor to link.

Each says only how the truth of its joint differs; how the motion goes on from there is `plant.py`'s.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ...robot.truth import JointTruth
from ..declaration import Family, GripFault, JointFault, TapKind
from ..parameters import parameter

if TYPE_CHECKING:
    from ...robot.world import World


@dataclass
class PayloadChange(JointFault, name="payload-change", family=Family.MECHANICS, acts_on={TapKind.LINK}):
    """A point mass hangs at the far end of the link; it is taken up and dropped without a push."""

    mass: float = parameter("mass of the payload", "kg", 0.3, 0.0, 2.0)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """The link, loaded."""
        return replace(joint, payload_kg=joint.payload_kg + self.mass)


@dataclass
class FrictionChange(JointFault, name="friction-change", family=Family.MECHANICS, acts_on={TapKind.LINK}):
    """The joint's friction is a multiple of what it was."""

    viscous: float = parameter("viscous friction, as a multiple", "", 3.0, 0.0, 20.0)
    coulomb: float = parameter("Coulomb friction, as a multiple", "", 3.0, 0.0, 20.0)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """More friction, or less."""
        return replace(
            joint,
            viscous_friction_nm_s=joint.viscous_friction_nm_s * self.viscous,
            coulomb_friction_nm=joint.coulomb_friction_nm * self.coulomb,
        )


@dataclass
class JointJam(JointFault, name="joint-jam", family=Family.MECHANICS, acts_on={TapKind.LINK}):
    """The joint stops dead and is held where it is, on the link's side of the drive wire."""

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """No motion."""
        return replace(joint, is_jammed=True)


@dataclass
class Collision(JointFault, name="collision", family=Family.MECHANICS, acts_on={TapKind.LINK}):
    """Something hits the link, once: the arm's speeds jump by what the impulse and the inertias make of it."""

    impulse: float = parameter("angular impulse about the joint, counter-clockwise", "N·m·s", 0.05, -0.2, 0.2)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """What hits does not stay."""
        return joint

    def strike(self, world: "World", joint: int) -> None:
        """The hit."""
        world.strike(joint, self.impulse)


@dataclass
class GripOpens(GripFault, name="grip-opens", family=Family.MECHANICS, acts_on={TapKind.GRIP}):
    """The hand lets go of the object: the other one has it alone or, without the master's, it falls."""

    def strike(self, world: "World", hand: str) -> None:
        """Open."""
        world.open_grip(hand)


@dataclass
class WireSlack(JointFault, name="wire-slack", family=Family.MECHANICS, acts_on={TapKind.DRIVE_WIRE}):
    """The drive wire hangs loose: motor and link twist against each other by so much before it pulls."""

    dead_band: float = parameter("free twist, either way, at the joint", "deg", 5.0, 0.0, 45.0)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """A free twist."""
        return _with_dead_band(joint, self.dead_band)


@dataclass
class Backlash(JointFault, name="backlash", family=Family.MECHANICS, acts_on={TapKind.DRIVE_WIRE}):
    """The gear has play, in series with the drive wire's stiffness."""

    play: float = parameter("play of the gear from flank to flank, at the joint", "deg", 1.0, 0.0, 10.0)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """A free twist of half the play."""
        return _with_dead_band(joint, self.play / 2)


@dataclass
class WireSoft(JointFault, name="wire-soft", family=Family.MECHANICS, acts_on={TapKind.DRIVE_WIRE}):
    """The drive wire stretches more than it should; a rigid one becomes elastic, of the cell's stiffness times this."""

    stiffness: float = parameter("stiffness, as a multiple", "", 0.2, 0.01, 1.0)

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """A softer wire."""
        stiffness_nm_rad = joint.wire_stiffness_nm_rad * self.stiffness
        return replace(joint, has_elastic_wire=True, wire_stiffness_nm_rad=stiffness_nm_rad)


@dataclass
class WireBroken(
    JointFault, name="wire-broken", family=Family.MECHANICS, acts_on={TapKind.DRIVE_WIRE}, is_dangerous=True
):
    """The drive wire is broken: the motor turns alone, its tachometer with it, and the link hangs in its bearing."""

    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """No wire."""
        return replace(joint, has_elastic_wire=True, wire_is_broken=True)


def _with_dead_band(joint: JointTruth, degrees: float) -> JointTruth:
    """Looseness adds up: a slack wire on a gear with play."""
    dead_band_rad = joint.wire_dead_band_rad + math.radians(degrees)
    return replace(joint, has_elastic_wire=True, wire_dead_band_rad=dead_band_rad)
