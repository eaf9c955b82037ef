"""Whether a body can have an inertia tensor: no rigid body breaks A + B ≥ C, whatever its shape.

Numbers only; the caller knows the joint and words the message.
"""

from collections.abc import Sequence

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
