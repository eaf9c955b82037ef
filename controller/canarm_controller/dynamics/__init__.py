"""Dynamics of the nominal robot: the closed form of two planar joints, the general fast forms, and their reference.

- `planar_pair`: `NominalArm`, KON-KUK I's joints 2 and 3 in closed form;
- `serial_arm`: `SerialArm`, any arm of a cell, by Newton-Euler (`newton_euler` recorded on a `tape`, carried out for
  one state by `scalar` and for tables by `batch`);
- `base_parameters`: the same, linear in the parameters that can be learned;
- `several`: `SeveralArms`, the arms of several robots as one; `nominal` chooses the form for a cell;
- `closed_chain`: what two arms can do that hold one object;
- `lagrange_euler`: the paper's trace form, slow and plain, against which the others are tested.
"""

from .arm import Arm
from .chain import Chain, ChainLink, Floats, chain_of
from .closed_chain import ClosedChain, HeldMotion
from .nominal import cell_arm, nominal_arm
from .planar_pair import COULOMB_SMOOTHING_RAD_S, NominalArm
from .serial_arm import SerialArm
from .several import SeveralArms

__all__ = [
    "COULOMB_SMOOTHING_RAD_S",
    "Arm",
    "Chain",
    "ChainLink",
    "ClosedChain",
    "Floats",
    "HeldMotion",
    "NominalArm",
    "SerialArm",
    "SeveralArms",
    "cell_arm",
    "chain_of",
    "nominal_arm",
]
