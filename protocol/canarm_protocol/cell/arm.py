"""The schema of a robot: links or bodies, motors, drives and sensors of its joints, and where its base stands.

Nominal values; what differs in the true robot never enters.
"""

from typing import Annotated, Literal, Self

from pydantic import Field

from .brakes import FittedBrake
from .drives import Drive
from .rigid import Inertial
from .sensors import Quantity, Sensor, Sensors
from .table import LARGEST, Finite, Name, NonNegative, NonZero, Positive, Sign, Table, Vector, at_least

LEAST_MASS_KG = 1e-6
"""MuJoCo takes no moving body below 1e-15 kg, and raises moments of inertia to 1e-12 kg m2; those of a milligram of
some centimetres are a thousand times that, so that its arm still is the one of the cell."""

Tensor = tuple[float, float, float, float, float, float]
Mass = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False), at_least(LEAST_MASS_KG)]


class Link(Table):
    """Standard Denavit-Hartenberg parameters of one revolute joint and the inertia of its link.

    `centre_of_mass_m` and about it `inertia_kg_m2` = [ixx, iyy, izz], `products_kg_m2` = [ixy, ixz, iyz] are in the
    link's own frame. `sign` = -1: the joint's angle counts the other way, theta = theta_offset - angle.
    """

    a_m: Finite
    alpha_deg: Finite
    d_m: Finite
    theta_offset_deg: Finite = 0.0
    sign: Sign = 1
    mass_kg: Mass
    centre_of_mass_m: Vector
    inertia_kg_m2: tuple[NonNegative, NonNegative, NonNegative]
    products_kg_m2: Vector = (0.0, 0.0, 0.0)

    @property
    def tensor_kg_m2(self) -> Tensor:
        """[ixx, iyy, izz, ixy, ixz, iyz]."""
        return (*self.inertia_kg_m2, *self.products_kg_m2)

    def with_inertial(self, mass_kg: float, centre_m: Vector, tensor: Tensor) -> Self:
        """The link with other masses."""
        moments = {"inertia_kg_m2": tensor[:3], "products_kg_m2": tensor[3:]}
        return self.model_copy(update={"mass_kg": mass_kg, "centre_of_mass_m": centre_m, **moments})


class Body(Table):
    """One revolute joint and its link as URDF has them: the joint's frame at angle 0 in the frame of the link before.

    `origin_rpy_deg` turns about the fixed axes x, y, z in this order. The joint turns about `axis`, a unit vector in
    its frame; the link's frame is the joint's frame turned about it, and with -`axis` its angle counts the other way.
    `centre_of_mass_m` is in the link's frame, and so is `inertia_kg_m2` = [ixx, iyy, izz, ixy, ixz, iyz] about the
    centre of mass.
    """

    origin_m: Vector
    origin_rpy_deg: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 0.0, 1.0)
    mass_kg: Mass
    centre_of_mass_m: Vector
    inertia_kg_m2: tuple[NonNegative, NonNegative, NonNegative, Finite, Finite, Finite]

    @property
    def tensor_kg_m2(self) -> Tensor:
        """`inertia_kg_m2`, as a `Link` has it too."""
        return self.inertia_kg_m2

    def with_inertial(self, mass_kg: float, centre_m: Vector, tensor: Tensor) -> Self:
        """The body with other masses."""
        return self.model_copy(update={"mass_kg": mass_kg, "centre_of_mass_m": centre_m, "inertia_kg_m2": tensor})


class Motor(Table):
    """DC motor, gear and wire drive of one joint.

    `sign` = -1: its leads are swapped, or it is mounted the other way round. `gear_ratio` below 0: the gear turns the
    direction round. Either makes a joint turn clockwise when the bridge is told to turn counter-clockwise.
    """

    torque_constant_nm_a: Positive
    gear_ratio: NonZero
    sign: Sign = 1
    gear_efficiency: Annotated[float, Field(gt=0, le=1)]
    rotor_inertia_kg_m2: Positive
    winding_ohm: Positive
    winding_mh: Positive
    viscous_friction_nm_s: NonNegative
    coulomb_friction_nm: NonNegative
    wire_stiffness_nm_rad: Positive

    @property
    def direction(self) -> Sign:
        """Sign of the joint torque when the bridge is told to turn counter-clockwise: -1 for a reversed drive."""
        return 1 if self.sign * self.gear_ratio > 0.0 else -1

    @property
    def torque_per_ampere(self) -> float:
        """K_I: joint torque per ampere of motor current, N·m/A. Currents have the sign of the joint torque."""
        return self.torque_constant_nm_a * abs(self.gear_ratio) * self.gear_efficiency

    @property
    def reflected_inertia_kg_m2(self) -> float:
        """Rotor inertia seen at the joint, N²·J_rotor, kg·m²."""
        return self.rotor_inertia_kg_m2 * self.gear_ratio**2

    @property
    def back_emf_v_s_rad(self) -> float:
        """Back-EMF per rad/s of joint speed, V·s/rad (K_e = K_t in SI units)."""
        return self.torque_constant_nm_a * abs(self.gear_ratio)


class Joint(Table):
    """One joint with its link (exactly one of `link` and `body`), motor, drive and sensors."""

    name: Name
    home_deg: Finite
    limits_deg: tuple[Finite, Finite]
    max_speed_rad_s: Positive | None = None
    """The highest speed that a motion may ask of it; unless given, what can be followed."""
    link: Link | None = None
    body: Body | None = None
    motor: Motor
    drive: Drive
    sensors: Sensors
    brake: FittedBrake = None

    @property
    def solid(self) -> Link | Body:
        """The rigid body that moves with the joint."""
        solid = self.body or self.link
        assert solid is not None, f"joint {self.name!r} has neither link nor body"
        return solid

    @property
    def dh_link(self) -> Link:
        """The joint's Denavit-Hartenberg link. Raises `ValueError` if it has a body instead."""
        if self.link is None:
            raise ValueError(f"joint {self.name!r} has a body, no Denavit-Hartenberg link")
        return self.link

    @property
    def mass_kg(self) -> float:
        """Mass of what moves with the joint."""
        return self.solid.mass_kg

    def carrying(self, load: Inertial) -> Self:
        """The joint with `load`, given in its link's frame, as a part of its link."""
        solid = self.solid
        xx, yy, zz, xy, xz, yz = solid.tensor_kg_m2
        own = Inertial(solid.mass_kg, solid.centre_of_mass_m, ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
        both = own.joined(load)
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = both.tensor_kg_m2
        laden = solid.with_inertial(both.mass_kg, both.centre_m, (xx, yy, zz, xy, xz, yz))
        return self.model_copy(update={"body" if self.body else "link": laden})

    def sensor(self, quantity: Quantity) -> Sensor | None:
        """The sensor that measures `quantity`; None without one."""
        return self.sensors.measuring(quantity)

    @property
    def allowed_rad_s(self) -> float:
        """The highest speed that a motion may ask for: what can be followed, or less if the cell says so."""
        stated = self.max_speed_rad_s
        return self.fastest_rad_s if stated is None else min(stated, self.fastest_rad_s)

    @property
    def fastest_rad_s(self) -> float:
        """The highest speed that can be followed: the tachometer's range or, without one, the no-load speed."""
        tachometer = self.sensor(Quantity.VELOCITY)
        if tachometer is not None:
            low, high = tachometer.seen()
            return min(-low, high)
        return self.drive.supply_v / self.motor.back_emf_v_s_rad


class Robot(Table):
    """A serial arm of revolute joints, base to tip.

    `base_m` and `base_rpy_deg` (about the fixed axes x, y, z in this order) place its base in the world;
    `gravity_m_s2` is in the base's frame. `when_lost` is what its outputs do when the controller is lost, and are left
    with at the end of a run. "off" and "carry" give them their `error_value`, "hold" lets them keep their last values.
    Only with "off" may the controller take the torque away: what "carry" gives must carry the arm where it works.
    """

    name: Name
    number: Annotated[int, Field(ge=1, le=7)]
    gravity_m_s2: Vector
    base_m: Vector = (0.0, 0.0, 0.0)
    base_rpy_deg: Vector = (0.0, 0.0, 0.0)
    when_lost: Literal["off", "carry", "hold"] = "off"
    joint: Annotated[tuple[Joint, ...], Field(min_length=1, max_length=7)]

    @property
    def holds(self) -> bool:
        """Whether it is never to be without torque, nor left so."""
        return self.when_lost != "off"

    def carrying(self, load: Inertial) -> Self:
        """The robot with `load`, given in its tool frame, as a part of its last link."""
        *others, last = self.joint
        return self.model_copy(update={"joint": (*others, last.carrying(load))})
