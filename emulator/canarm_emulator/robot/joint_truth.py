"""The true parameters of one joint: mechanics, motor, supply by name, and what its kinds of sensor declare."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class JointTruth:
    """True parameters of one joint. Only faults set those with a default; they are no keys of `--truth`."""

    mass_kg: float
    viscous_friction_nm_s: float
    coulomb_friction_nm: float
    torque_constant_nm_a: float
    rotor_inertia_kg_m2: float
    winding_ohm: float
    has_elastic_wire: bool
    wire_stiffness_nm_rad: float
    sensors: Mapping[str, float]
    """True values of the sensors, by the names that their kinds declare."""
    supply_v: float
    initial_deg: float
    payload_kg: float = 0.0
    """Point mass at the far end of the link, where the next link's axis is."""
    is_jammed: bool = False
    """The joint is held on the link's side of the drive wire."""
    wire_dead_band_rad: float = 0.0
    """Twist of an elastic wire, either way, over which it has no tension."""
    wire_is_broken: bool = False
    """An elastic wire connects nothing: the motor turns alone and the link hangs."""
    shorted_turns: float = 0.0
    """Share of the winding's turns that are shorted."""
    brake_is_released: bool = False
    """The brake does not engage."""
    brake_slip: float = 0.0
    """What an engaged brake lacks of its torque, as a share."""
    brake_drag: float = 0.0
    """What a released brake still has of it."""
