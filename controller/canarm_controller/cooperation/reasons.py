"""Why a pose, or a whole plan, is not to be had: the reasons, their words, and the error that names one."""

from enum import IntEnum

from ..errors import CooperationError


class Reason(IntEnum):
    """Why an arm cannot do what is asked; a small number each, so that arrays can hold them."""

    NONE = 0
    OUT_OF_REACH = 1
    YAW = 2
    BASE_AXIS = 3
    PARALLEL = 4
    JOINT_LIMIT = 5
    BRANCH_FLIP = 6
    SINGULAR = 7
    OFF_PATH = 8

    @property
    def words(self) -> str:
        """The reason in a few words."""
        return _WORDS[self]


_WORDS = {
    Reason.NONE: "works",
    Reason.OUT_OF_REACH: "out of reach",
    Reason.YAW: "yaw: the approach vector leaves the plane through the base's axis",
    Reason.BASE_AXIS: "the point lies on the base's axis",
    Reason.PARALLEL: "parallel vectors: the object's approach is across the slave's plane, the hand's is open",
    Reason.JOINT_LIMIT: "beyond a joint limit",
    Reason.BRANCH_FLIP: "a joint would jump to another branch",
    Reason.SINGULAR: "singular: joints would race",
    Reason.OFF_PATH: "off the path",
}


class RefusedPlanError(CooperationError):
    """A plan that cannot be carried out; nothing has moved.

    `reason`, `robot` ("master" or "slave") and `pose`, the number of the first pose (from 0) that fails, say what the
    message says.
    """

    def __init__(self, reason: Reason, robot: str, pose: int, detail: str) -> None:
        super().__init__(f"{robot}, pose {pose}: {reason.words}: {detail}")
        self.reason = reason
        self.robot = robot
        self.pose = pose
