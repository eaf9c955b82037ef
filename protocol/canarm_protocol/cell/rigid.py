"""Poses and inertias of rigid bodies in plain Python: only what joining two bodies needs.

Matrices are tuples of rows; units are m, rad, kg and kg·m². No robot, file or array library may enter.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

Triple = tuple[float, float, float]
Rotation = tuple[Triple, Triple, Triple]
IDENTITY: Rotation = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_QUARTER_TURNS = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}


class Pose(NamedTuple):
    """A frame seen from another one: a point p of the inner frame is at rotation·p + origin_m in the outer one."""

    origin_m: Triple = (0.0, 0.0, 0.0)
    rotation: Rotation = IDENTITY

    def point(self, inner_m: Sequence[float]) -> Triple:
        """A point of the inner frame as the outer one sees it."""
        x, y, z = turned(self.rotation, inner_m)
        return (x + self.origin_m[0], y + self.origin_m[1], z + self.origin_m[2])

    def then(self, inner: "Pose") -> "Pose":
        """The pose in the outer frame of a frame that is at `inner` in this one."""
        return Pose(self.point(inner.origin_m), product(self.rotation, inner.rotation))


class Inertial(NamedTuple):
    """Mass, centre of mass, and the inertia tensor about it along the axes of the frame."""

    mass_kg: float
    centre_m: Triple
    tensor_kg_m2: Rotation

    def seen_from(self, pose: Pose) -> "Inertial":
        """The same body in the outer frame of `pose`: R·I·Rᵀ."""
        rotation = pose.rotation
        tensor = product(product(rotation, self.tensor_kg_m2), transposed(rotation))
        return Inertial(self.mass_kg, pose.point(self.centre_m), tensor)

    def joined(self, other: "Inertial") -> "Inertial":
        """Both bodies as one, about their common centre of mass, by the parallel-axis theorem."""
        mass_kg = self.mass_kg + other.mass_kg
        x, y, z = (
            (self.mass_kg * a + other.mass_kg * b) / mass_kg for a, b in zip(self.centre_m, other.centre_m, strict=True)
        )
        moved, others = (each._about((x, y, z)) for each in (self, other))
        rows = [
            tuple(a + b for a, b in zip(row, other_row, strict=True))
            for row, other_row in zip(moved, others, strict=True)
        ]
        return Inertial(mass_kg, (x, y, z), (_triple(rows[0]), _triple(rows[1]), _triple(rows[2])))

    def _about(self, point_m: Triple) -> Rotation:
        d = [a - b for a, b in zip(self.centre_m, point_m, strict=True)]
        square = sum(each * each for each in d)
        rows = [
            tuple(self.tensor_kg_m2[i][k] + self.mass_kg * ((i == k) * square - d[i] * d[k]) for k in range(3))
            for i in range(3)
        ]
        return _triple(rows[0]), _triple(rows[1]), _triple(rows[2])


def exact_cos_sin(angle_deg: float) -> tuple[float, float]:
    """Cosine and sine with true zeros at quarter turns, where rounding would leave 6e-17."""
    exact = _QUARTER_TURNS.get(angle_deg % 360.0)
    return exact or (math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg)))


def from_rpy(roll: float, pitch: float, yaw: float) -> Rotation:
    """Rz(yaw)·Ry(pitch)·Rx(roll): turns about the fixed axes x, y, z in this order, as URDF has it. Angles in rad."""
    return _turns(*((math.cos(angle), math.sin(angle)) for angle in (roll, pitch, yaw)))


def from_rpy_deg(rpy_deg: Triple) -> Rotation:
    """As `from_rpy`, from degrees: quarter turns are exact."""
    return _turns(*map(exact_cos_sin, rpy_deg))


def _turns(roll: tuple[float, float], pitch: tuple[float, float], yaw: tuple[float, float]) -> Rotation:
    """From the cosine and the sine of each angle."""
    (cr, sr), (cp, sp), (cy, sy) = roll, pitch, yaw
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def to_rpy(rotation: Rotation) -> Triple:
    """Roll, pitch and yaw of a rotation, rad; at a pitch of ±90° only the sum of roll and yaw is known, roll is 0."""
    across = math.hypot(rotation[0][0], rotation[1][0])
    pitch = math.atan2(-rotation[2][0], across)
    if across < 1e-12:
        yaw = math.atan2(-rotation[0][1], rotation[1][1])
        return (0.0, pitch + 0.0, yaw + 0.0)
    # -0.0 + 0.0 is 0.0.
    return math.atan2(rotation[2][1], rotation[2][2]), pitch + 0.0, math.atan2(rotation[1][0], rotation[0][0]) + 0.0


def turned(rotation: Rotation, vector: Sequence[float]) -> Triple:
    """`rotation`·`vector`."""
    return _triple([sum(a * b for a, b in zip(row, vector, strict=True)) for row in rotation])


def product(left: Rotation, right: Rotation) -> Rotation:
    """The product of two 3×3 matrices."""
    columns = transposed(right)
    rows = [_triple([sum(a * b for a, b in zip(row, column, strict=True)) for column in columns]) for row in left]
    return rows[0], rows[1], rows[2]


def transposed(matrix: Rotation) -> Rotation:
    """Rows as columns."""
    return tuple(zip(*matrix, strict=True))  # type: ignore[return-value]  # mypy does not count them


def _triple(values: Sequence[float]) -> Triple:
    x, y, z = values
    return (x, y, z)
