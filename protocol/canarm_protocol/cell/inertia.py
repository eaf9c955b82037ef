"""Whether a body can have an inertia tensor: no rigid body breaks A + B ≥ C, whatever its shape.

Numbers only; the caller knows the joint and words the message.
"""

import math
from collections.abc import Sequence

from .arm import Body, Link

TOLERANCE = 1e-9
"""Allowed excess as a share of the largest moment: thin plates have A + B = C, and rotated tensors are rounded."""


def is_possible(moments: Sequence[float], products: Sequence[float] = (0.0, 0.0, 0.0)) -> bool:
    """Whether a body with moments [xx, yy, zz] and products [xy, xz, yz] can exist.

    No principal minor of its second moments of mass, Σ = ½ tr(I)·E - I, may be negative. That is equivalent to: any two
    principal moments of I are together at least the third.
    """
    half = 0.5 * sum(moments)
    xx, yy, zz = (half - moment for moment in moments)
    xy, xz, yz = (-product for product in products)
    unit = max(abs(half), *map(abs, products))
    if unit == 0.0:
        return True
    xx, yy, zz, xy, xz, yz = (each / unit for each in (xx, yy, zz, xy, xz, yz))
    minors = (
        xx,
        yy,
        zz,
        xx * yy - xy * xy,
        xx * zz - xz * xz,
        yy * zz - yz * yz,
        xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz),
    )
    return all(minor >= -TOLERANCE for minor in minors)


def own_inertia_kg_m2(solid: Link | Body) -> float:
    """Moment of inertia of what one joint moves about the joint's axis, links beyond left out.

    By the parallel-axis theorem; in a Denavit-Hartenberg link's frame the axis has the direction (0, sin α, cos α) and
    passes at a distance of a.
    """
    if isinstance(solid, Link):
        angle = math.radians(solid.alpha_deg)
        axis = (0.0, math.sin(angle), math.cos(angle))
        x, y, z = solid.centre_of_mass_m
        arm = (x + solid.a_m, y, z)
    else:
        axis, arm = solid.axis, solid.centre_of_mass_m
    xx, yy, zz, xy, xz, yz = solid.tensor_kg_m2
    x, y, z = axis
    about_centre = xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z)
    along = sum(a * b for a, b in zip(axis, arm, strict=True))
    return about_centre + solid.mass_kg * max(sum(each * each for each in arm) - along * along, 0.0)
