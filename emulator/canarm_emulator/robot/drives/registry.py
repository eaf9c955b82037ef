"""The kinds of drive in the true robot, by the names that they have in a cell. A new kind is one line here."""

from canarm_protocol.cell.model import Joint

from ..joint_truth import JointTruth
from .base import DriveKind, DriveModel
from .d669 import D669

DRIVES: dict[str, DriveKind] = {"d669": D669}


def make_drive(joint: Joint, truth: JointTruth) -> DriveModel:
    """The true drive of a joint."""
    return DRIVES[joint.drive.kind].make(joint, truth)
