"""The kinds of brake in the true robot, by the names that they have in a cell. A new kind is one line here."""

from collections.abc import Callable
from typing import Any

from canarm_protocol.cell.model import Joint

from ..joint_truth import JointTruth
from .base import BrakeModel
from .dynamic import DynamicBrakeModel
from .spring import SpringBrakeModel

_MAKERS: dict[str, Callable[[Joint, Any, JointTruth], BrakeModel]] = {
    "dynamic": DynamicBrakeModel,
    "spring": SpringBrakeModel,
}


def make_brake(joint: Joint, truth: JointTruth) -> BrakeModel | None:
    """The true brake of a joint; None where it has none."""
    brake = joint.brake
    return None if brake is None else _MAKERS[brake.kind](joint, brake, truth)
