"""Whether the parts of a robot fit together: bodies, limits, sensors. The schema checks single values."""

import math
from collections import Counter
from collections.abc import Iterator

from .arm import Body, Joint, Robot
from .inertia import is_possible, own_inertia_kg_m2
from .sensors import AnalogueSensor, Quantity

_SMALL = 1e-6
"""A unit vector's length may be off by this much, from rounding in a file."""

_MOST_INERTIA_KG_M2 = 1e6
"""Largest inertia of a rotor, seen at the joint: a thousand times that of the largest robots. More is a wrong unit."""
_LEAST_INERTIA_KG_M2 = 1e-9
"""Smallest inertia of a joint with its rotor: a thousand times what MuJoCo raises moments of inertia to."""
_MOST_GRAVITY_M_S2 = 100.0
_SHORTEST_S, _LONGEST_S = 1e-7, 1.0
"""Time constant of a winding; beyond this a unit is wrong."""


def robot_problems(robot: Robot) -> Iterator[str]:
    """The problems of one robot."""
    strength = math.hypot(*robot.gravity_m_s2)
    if strength > _MOST_GRAVITY_M_S2:
        yield f"robot {robot.name!r}.gravity_m_s2: is {strength:g} m/s2 strong; at most {_MOST_GRAVITY_M_S2:g}"


def joint_problems(name: str, joint: Joint) -> Iterator[str]:
    """The problems of one joint; `name` is its name in the whole cell."""
    where = f"joint {name!r}"
    if (joint.link is None) == (joint.body is None):
        found = "neither [robot.joint.link] nor" if joint.link is None else "both [robot.joint.link] and"
        yield f"{where}: has {found} [robot.joint.body]; give one"
    if joint.body is not None:
        yield from _body_problems(f"{where}.body", joint.body)
    for key, solid in (("link", joint.link), ("body", joint.body)):
        if solid is not None and not is_possible(solid.tensor_kg_m2[:3], solid.tensor_kg_m2[3:]):
            listed = ", ".join(f"{each:g}" for each in solid.inertia_kg_m2)
            yield (
                f"{where}.{key}.inertia_kg_m2 = [{listed}]: no body has it; any two of its principal moments must be "
                "at least the third together (A + B >= C)"
            )
    low, high = joint.limits_deg
    if not low < high:
        yield f"{where}.limits_deg = [{low:g}, {high:g}]: must be [lower, upper] with lower < upper"
    elif not low <= joint.home_deg <= high:
        yield f"{where}.home_deg = {joint.home_deg:g}: must lie within limits_deg = [{low:g}, {high:g}]"
    yield from _motor_problems(f"{where}.motor", joint)
    yield from _sensor_problems(where, joint)


def _motor_problems(where: str, joint: Joint) -> Iterator[str]:
    motor = joint.motor
    inertia_kg_m2 = motor.rotor_inertia_kg_m2 * motor.gear_ratio * motor.gear_ratio
    if not inertia_kg_m2 <= _MOST_INERTIA_KG_M2:
        yield (
            f"{where}.gear_ratio = {motor.gear_ratio:g}: rotor_inertia_kg_m2 = {motor.rotor_inertia_kg_m2:g} times its "
            f"square is {inertia_kg_m2:g} kg m2 at the joint; at most {_MOST_INERTIA_KG_M2:g}"
        )
    elif joint.body is not None or joint.link is not None:
        own_kg_m2 = inertia_kg_m2 + own_inertia_kg_m2(joint.solid)
        if own_kg_m2 < _LEAST_INERTIA_KG_M2:
            yield (
                f"{where}.rotor_inertia_kg_m2 = {motor.rotor_inertia_kg_m2:g}: times gear_ratio = {motor.gear_ratio:g} "
                f"squared, with the link's own inertia about the axis, it is {own_kg_m2:.3g} kg m2; "
                f"at least {_LEAST_INERTIA_KG_M2:g}"
            )
    still_s = motor.winding_mh * 1e-3 / motor.winding_ohm
    if not _SHORTEST_S <= still_s <= _LONGEST_S:
        yield (
            f"{where}.winding_mh = {motor.winding_mh:g}: over winding_ohm = {motor.winding_ohm:g} it makes a time "
            f"constant of {still_s:g} s; must be {_SHORTEST_S:g} to {_LONGEST_S:g} s"
        )


def _body_problems(where: str, body: Body) -> Iterator[str]:
    length = math.hypot(*body.axis)
    if abs(length - 1.0) > _SMALL:
        yield f"{where}.axis = {list(body.axis)}: must be a unit vector; its length is {length:g}"


def _sensor_problems(where: str, joint: Joint) -> Iterator[str]:
    low, high = joint.limits_deg
    fitted, is_sound = joint.sensors.fitted(), True
    for sensor in fitted:
        for problem in sensor.problems():
            is_sound = False
            yield f"{where}.sensors.{sensor.kind}.{problem}"
    for quantity, count in Counter(sensor.quantity for sensor in fitted).items():
        if count > 1:
            kinds = " and ".join(sensor.kind for sensor in fitted if sensor.quantity is quantity)
            yield f"{where}.sensors: {kinds} measure {quantity} both; a joint has one sensor for it"
    position = joint.sensor(Quantity.POSITION)
    if position is None:
        yield f"{where}.sensors: none measures position; a joint needs one, such as [robot.joint.sensors.potentiometer]"
    elif is_sound:
        lowest, highest = map(math.degrees, position.seen())
        if low < lowest - _SMALL or high > highest + _SMALL:
            zero = f" with zero_v = {position.nominal_zero_v:g}" if isinstance(position, AnalogueSensor) else ""
            yield (
                f"{where}.limits_deg = [{low:g}, {high:g}]: the {position.title}{zero} sees {lowest:g} to "
                f"{highest:g} degrees; stay within"
            )
