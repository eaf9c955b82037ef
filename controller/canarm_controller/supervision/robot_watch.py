"""What the joints of one robot have in common: the expected motion, what surprises, and which joint is to blame for it.

Owns who is asked when; what is judged is in the modules that it joins.
"""

from collections.abc import Sequence

from ..dynamics import Arm
from .blame import PAST_CYCLES, Blame, Finding, Moment
from .currents import CurrentWatch
from .detection import Reaction
from .expectation import ArmExpectation, expectation
from .nominal import JointNominal
from .surprise import ArmReport, SurpriseWatch, Witness
from .thresholds import Thresholds
from .timing import Timing
from .witness import JointWitness

Past = Sequence[Moment]


class RobotWatch:
    """State shared by the joints of one robot. `joints` are their indices in the cell.

    `past` are the last cycles of all joints of the cell, oldest first.
    """

    def __init__(
        self, arm: Arm, joints: slice, witnesses: Sequence[Witness], currents: Sequence[CurrentWatch | None],
        nominals: Sequence[JointNominal], limits: Sequence[Thresholds], timing: Timing, past: Past, report: ArmReport,
    ) -> None:  # fmt: skip
        self.joints, self._witnesses, self._arm, self._past = joints, witnesses, arm, past
        self._wired = [(index, joint) for index, joint in enumerate(witnesses) if isinstance(joint, JointWitness)]
        self.expected: ArmExpectation = expectation(arm)
        self._blame: Blame | None = None
        """None of a single joint, and where speeds are not measured."""
        if len(self._wired) == len(witnesses) > 1:
            self._blame = Blame(arm, nominals, limits, timing.period_s)

        def tell(detector: str, index: int, detail: str, reaction: Reaction | None) -> bool:
            return report(detector, joints.start + index, detail, reaction)

        self.surprise = SurpriseWatch(
            witnesses, limits, arm.torque_per_ampere, currents, timing, self.expected, self.find, tell
        )

    def find(self, with_tachometers: bool = False) -> Finding | None:
        """What the last cycles tell of the arm, if there are enough of them and all speeds are measured."""
        if self._blame is None or len(self._past) < PAST_CYCLES:
            return None
        own = self.joints
        past = [(speed[own], model[own], bias[own], torque[own]) for speed, model, bias, torque in self._past]
        compliance = [joint.compliance_rad_nm for _, joint in self._wired]
        return self._blame.find(past, self.expected.inertia, compliance, with_tachometers)

    def struck(self, index: int) -> int | None:
        """The joint where the arm itself was struck or has failed, rather than the tachometer of joint `index`.

        Both are indices in the cell. None if that is not so, or not known.
        """
        first: int = self.joints.start
        finding = self.find(with_tachometers=True)
        if finding is None or not finding.is_arm(index - first):
            return None
        return first + finding.joint

    def twist(self, speed_rad_s: Sequence[float], acted_nm: Sequence[float]) -> None:
        """What changes slowly, once in 10 ms: which joints turn, and what their wires carry."""
        self.surprise.turn(speed_rad_s)
        if self._wired:
            accelerations, friction_nm = self.expected.accelerations(acted_nm), self._arm.friction(speed_rad_s)
            for index, joint in self._wired:
                joint.twist(acted_nm[index] - friction_nm[index], accelerations[index])

    def look_into(self, count: int, speed_rad_s: Sequence[float], acted_nm: Sequence[float], may_stop: bool) -> None:
        """Judge one cycle of unexpected accelerations."""
        if self.surprise.is_open:
            self.surprise.step(count, speed_rad_s, acted_nm, may_stop)
        elif any(joint.is_agitated for joint in self._witnesses):
            self.surprise.open(count, speed_rad_s)
