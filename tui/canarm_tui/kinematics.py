"""Where the joints of a cell's robots are, for many poses at once: what a picture of the arm is drawn from.

Nominal geometry only, from the cell. Angles in rad, places in m, in the world.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.arm import Body, Joint, Robot
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.rigid import from_rpy_deg

Floats = NDArray[np.float64]


def joint_places(cell: Cell, angles_rad: Floats) -> list[Floats]:
    """For each robot the places (n, points, 3) of its base, joints and tip, of `angles_rad` (n, all joints)."""
    blocks = zip(cell.robot, cell.blocks, strict=True)
    return [_places(robot, angles_rad[:, block]) for robot, block in blocks]


def _places(robot: Robot, angles_rad: Floats) -> Floats:
    count = len(angles_rad)
    frame = np.broadcast_to(_step(robot.base_m, np.array(from_rpy_deg(robot.base_rpy_deg))), (count, 4, 4))
    places = [frame[:, :3, 3]]
    for number, joint in enumerate(robot.joint):
        if joint.body is not None:
            frame = frame @ _step(joint.body.origin_m, np.array(from_rpy_deg(joint.body.origin_rpy_deg)))
            places.append(frame[:, :3, 3])
        frame = frame @ _turn(joint, angles_rad[:, number])
        if joint.body is None:
            places.append(frame[:, :3, 3])
    if robot.joint[-1].body is not None:
        places.append((frame @ _beyond(robot.joint[-1].body))[:, :3, 3])
    return np.stack(places, axis=1)


def _turn(joint: Joint, angle_rad: Floats) -> Floats:
    if joint.body is not None:
        return _about(joint.body.axis, angle_rad)
    link = joint.dh_link
    turned = _about((0.0, 0.0, 1.0), link.sign * angle_rad + np.radians(link.theta_offset_deg))
    return turned @ _step((link.a_m, 0.0, link.d_m), np.array(from_rpy_deg((link.alpha_deg, 0.0, 0.0))))


def _beyond(body: Body) -> Floats:
    """URDF has no tip: as far beyond the centre of mass as that is from the last joint."""
    return _step([2.0 * each for each in body.centre_of_mass_m], np.eye(3))


def _step(origin_m: Sequence[float], rotation: Floats) -> Floats:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = rotation, origin_m
    return frame


def _about(axis: Sequence[float], angle_rad: Floats) -> Floats:
    """Rotations (n, 4, 4) about `axis`, a unit vector: Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, rest = np.sin(angle_rad)[:, None, None], (1.0 - np.cos(angle_rad))[:, None, None]
    frames = np.zeros((len(angle_rad), 4, 4))
    frames[:, 3, 3] = 1.0
    frames[:, :3, :3] = np.eye(3) + sine * cross + rest * (cross @ cross)
    return frames
