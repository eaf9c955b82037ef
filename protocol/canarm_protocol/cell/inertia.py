"""Whether a body can have an inertia tensor: no rigid body breaks A + B ≥ C, whatever its shape.

Numbers only; what is said of them, and of which joint, is the caller's.
"""

from collections.abc import Sequence

TOLERANCE = 1e-9
"""Of the largest moment: thin rods and plates have A + B = C, and their tensors are turned with rounded numbers."""


def is_possible(moments: Sequence[float], products: Sequence[float] = (0.0, 0.0, 0.0)) -> bool:
    """Whether moments [xx, yy, zz] and products [xy, xz, yz] are of a body.

    A body's second moments of mass are Σ = ½ tr(I)·E - I, of which no principal minor is negative; that no two
    principal moments of I are less than the third is the same.
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
