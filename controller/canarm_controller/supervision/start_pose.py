"""Whether an arm whose encoders count from where it was switched on stands where the cell says that it does.

A wrong pose has the wrong weight: the model lacks something from the first drive on, before a sensor can be blamed.
Owns that suspicion; what is lacking is measured elsewhere.
"""

from collections.abc import Sequence

from canarm_protocol.cell.model import Cell

from .detection import DETECTORS, Reaction
from .joint_state import JointState
from .nominal import JointNominal
from .surprise import ArmReport
from .thresholds import unmodelled_rad_s2
from .timing import Timing

START_POSE = "start-pose"
WRONG_SHARE = 0.75
"""Of all that payload and friction of the box make: what lacks more is rather a pose. An arm as the cell describes it
lacks 0.0, one that hangs instead of lying level 1.0 to 1.8."""
LASTING_REFRESHES = 10
"""0.1 s: blows and friction that turns are over by then."""
ACCUSED = frozenset(
    f"encoder-{what}" for what in ("jump", "stuck", "mismatch")
) | {"acceleration-mismatch", "following-error", "wrong-direction"}  # fmt: skip
"""Detectors that compare a joint with its model, or with a sensor that the model is believed more than."""


class StartPose:
    """Joints of one cell. Only encoders that are not homed are in doubt, and only what is lacking from the start on."""

    def __init__(self, cell: Cell, nominals: Sequence[JointNominal], timing: Timing) -> None:
        self._timing = timing
        is_assumed = cell.control.homing is None
        self._robots: list[tuple[slice, list[float]]] = []
        for robot, joints in zip(cell.robot, cell.blocks, strict=True):
            if is_assumed and any(joint.sensors.encoder is not None for joint in robot.joint):
                most = [WRONG_SHARE * unmodelled_rad_s2(each) for each in nominals[joints]]
                self._robots.append((joints, most))
        self._names = cell.joint_names
        self._home_deg = [joint.home_deg for joint in cell.joints]
        self.start()

    def start(self) -> None:
        """The arm is believed to stand at home."""
        self._lasting = [0] * len(self._names)
        self._found: dict[int, tuple[int, float]] = {}

    def look(self, joints: Sequence[JointState], cycle: int) -> None:
        """Once in 10 ms: what the models of all joints lack."""
        if cycle > self._timing.early:
            return
        for number, (own, most) in enumerate(self._robots):
            for index, limit in enumerate(most, own.start):
                bias = joints[index].bias
                lasting = self._lasting[index] + 1 if abs(bias) > limit else 0
                self._lasting[index] = lasting
                if lasting >= LASTING_REFRESHES and abs(bias) > abs(self._found.get(number, (0, 0.0))[1]):
                    self._found[number] = index, bias

    def doubt(self, index: int) -> tuple[int, str] | None:
        """The joint that lacks most of those of this joint's robot, and what is said of it; None without a doubt."""
        for number, (own, _) in enumerate(self._robots):
            if own.start <= index < own.stop and number in self._found:
                joint, bias = self._found[number]
                home = f"home_deg = {self._home_deg[joint]:g}"
                return (
                    joint,
                    f"lacks {bias:+.0f} rad/s2 since the start: does the arm stand at {home}, as its encoders say?",
                )
        return None

    def naming(self, report: ArmReport) -> ArmReport:
        """`report`, with the pose accused where it is in doubt, instead of what stops the run because of the model."""
        if not self._robots:
            return report

        def named(detector: str, index: int, detail: str, reaction: Reaction | None) -> bool:
            taken = reaction or DETECTORS[detector].reaction
            doubt = self.doubt(index) if detector in ACCUSED and taken.stops else None
            if doubt is not None:
                joint, said = doubt
                if report(START_POSE, joint, f"{said} ({detector}: {self._names[index]}, {detail})", taken):
                    return True
            return report(detector, index, detail, reaction)

        return named
