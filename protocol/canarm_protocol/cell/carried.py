"""The schema of an object that two robots carry: a long, thin body, and where each of them holds it."""

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

from pydantic import Field, model_validator

from .arm import Mass, Robot
from .rigid import Inertial, Rotation
from .table import Finite, Name, Positive, Table, Vector


class Carried(Table):
    """A straight rod that `master` holds at its end and `slave` at `grasp_distance_m` from there.

    In the tool frame of the master, the frame of its last link, the rod begins at the origin. With both angles 0 it
    lies along x; `theta_x_deg` turns it about z, then `theta_z_deg` lifts it out of x and y (Lee, Suh, Suh and Kim,
    equation (2)). The master's grip lets it neither move nor turn, the slave's only holds the point. A grip slips when
    its force passes `slip_force_n`. The controller lets the slave carry `slave_share` of the mass, and shows its law
    `grip_stiffness` of the errors that the grips do not allow.

    It is in both hands from the beginning or, `on_stand`, lies where they are at home. There they close in `closing_s`
    when an output of a card tells them to, and once both hold it the stand sinks away from under it in `taken_up_s`.
    """

    master: Name
    slave: Name
    length_m: Positive
    diameter_m: Positive
    mass_kg: Mass
    grasp_distance_m: Positive
    """Half of `length_m` unless given."""
    theta_x_deg: Finite = 0.0
    theta_z_deg: Finite = 0.0
    slip_force_n: Positive
    slave_share: Annotated[float, Field(ge=0, le=1)] = 0.5
    grip_stiffness: Annotated[float, Field(ge=0, le=1)] = 0.2
    on_stand: bool = False
    closing_s: Positive = 0.5
    taken_up_s: Positive = 0.5

    @model_validator(mode="before")
    @classmethod
    def _held_in_the_middle(cls, values: Any) -> Any:
        length_m = values.get("length_m") if isinstance(values, dict) else None
        if not isinstance(length_m, float | int) or "grasp_distance_m" in values:
            return values
        return {**values, "grasp_distance_m": 0.5 * length_m}

    @property
    def direction(self) -> Vector:
        """Of the rod in the master's tool frame, a unit vector."""
        theta_x, theta_z = math.radians(self.theta_x_deg), math.radians(self.theta_z_deg)
        level = math.cos(theta_z)
        return level * math.cos(theta_x), level * math.sin(theta_x), math.sin(theta_z)

    @property
    def moments_kg_m2(self) -> tuple[float, float]:
        """Of a uniform cylinder about its centre: along its axis, and across."""
        radius_m = self.diameter_m / 2
        along = self.mass_kg * radius_m**2 / 2
        return along, along / 2 + self.mass_kg * self.length_m**2 / 12

    def loads(self) -> dict[str, Inertial]:
        """What each robot's last link carries, by the robot's name, in its tool frame.

        The slave has its share as a point at its grip, the master the rod without that point. Of the inertia that is
        exact only while the slave's grip follows the master's, as it does.
        """
        x, y, z = self.direction
        point_kg, rod_kg = self.slave_share * self.mass_kg, (1.0 - self.slave_share) * self.mass_kg
        along, across = self.moments_kg_m2
        moment = self.mass_kg * self.length_m / 2 - point_kg * self.grasp_distance_m
        centre_m = moment / rod_kg if rod_kg else 0.0
        # About the grip, without the point, then about the centre.
        across += self.mass_kg * (self.length_m / 2) ** 2 - point_kg * self.grasp_distance_m**2
        across -= rod_kg * centre_m**2
        nothing: Rotation = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        axis = (x, y, z)
        tensor = [[across * (i == k) + (along - across) * axis[i] * axis[k] for k in range(3)] for i in range(3)]
        rows = [(row[0], row[1], row[2]) for row in tensor]
        centre = (centre_m * x, centre_m * y, centre_m * z)
        return {
            self.master: Inertial(rod_kg, centre, (rows[0], rows[1], rows[2])),
            self.slave: Inertial(point_kg, (0.0, 0.0, 0.0), nothing),
        }


def carried_problems(carried: Carried, robots: Sequence[Robot]) -> Iterator[str]:
    """What does not fit together in `[object]`."""
    names = [robot.name for robot in robots]
    for robot in robots:
        for joint in robot.joint:
            if robot.name in (carried.master, carried.slave) and (joint.link is None or joint.link.sign < 0):
                yield (
                    f"object: robot {robot.name!r}, joint {joint.name!r}: a robot that carries must have "
                    "[robot.joint.link] with sign = 1 at every joint"
                )
    for key, name in (("master", carried.master), ("slave", carried.slave)):
        if name not in names:
            yield f'object.{key} = "{name}": no such robot; this cell has {", ".join(names)}'
    if carried.master == carried.slave:
        yield f'object.slave = "{carried.slave}": is object.master; two robots carry the object'
    if carried.grasp_distance_m > carried.length_m:
        yield (
            f"object.grasp_distance_m = {carried.grasp_distance_m:g}: is beyond the object's end; at most "
            f"length_m = {carried.length_m:g}"
        )
    if carried.diameter_m > carried.length_m:
        yield f"object.diameter_m = {carried.diameter_m:g}: is more than length_m = {carried.length_m:g}"
