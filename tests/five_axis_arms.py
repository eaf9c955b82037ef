"""Two five-axis arms that carry one object, and any chain as Pinocchio has it: for the tests of cooperation."""

import math

import numpy as np
import pinocchio

from canarm.cooperation import RHINO_XR, ArmPair, CarriedObject, DhChain, FiveAxisArm, circle

START = np.radians([0.0, -80.0, 90.0, -10.0, 90.0])
PAIR = ArmPair(master=RHINO_XR, slave=RHINO_XR, carried=CarriedObject(length_m=0.6), slave_base_m=(-0.28, -0.30, 0.0))
LAP = circle(seconds=0.9)
"""360 steps."""
MIRRORED = FiveAxisArm(
    d_m=(0.35, 0.0, 0.0, 0.0, 0.09),
    a_m=(0.05, 0.30, 0.25, -0.02, 0.0),
    alpha_deg=(90.0, 0.0, 0.0, 90.0, 0.0),
    theta_offset_deg=(10.0, 90.0, -20.0, 5.0, -30.0),
)
"""Everything the other way round, with an offset shoulder."""


def pinocchio_model(chain: DhChain) -> pinocchio.Model:
    """The chain as Pinocchio has it, with the tip's frame as the last one."""
    model, parent, place = pinocchio.Model(), 0, pinocchio.SE3.Identity()
    for offset, d, a, alpha in zip(chain.offsets_rad, chain.d_m, chain.a_m, chain.alpha_deg, strict=True):
        before = place * pinocchio.SE3(pinocchio.utils.rotate("z", offset), np.zeros(3))
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), before, f"joint{parent + 1}")
        place = pinocchio.SE3(pinocchio.utils.rotate("x", math.radians(alpha)), np.array([a, 0.0, d]))
    model.addFrame(pinocchio.Frame("tip", parent, place, pinocchio.FrameType.OP_FRAME))
    return model
