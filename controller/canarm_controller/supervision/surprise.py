"""Unexpected accelerations: which torque is missing or excessive, and whether the drive is the cause.

Owns what is measured over a few cycles after a joint's witness has been agitated. The cycle's own residuals must not
enter.
"""

from collections.abc import Callable, Sequence

from .blame import Finding
from .currents import CurrentWatch
from .detection import Reaction
from .expectation import ArmExpectation
from .joint_state import Mode
from .tachless import TachlessWitness
from .thresholds import Thresholds
from .timing import Timing
from .witness import JointWitness

Witness = JointWitness | TachlessWitness

ArmReport = Callable[[str, int, str, Reaction | None], bool]
"""Detector, index of the joint, detail, and the reaction if it is not the table's."""

WRONG_DIRECTION = 1.5, 2.6
"""Missing over commanded torque: 2 for a reversed bridge, 1 for none, at most 1 for a payload twice as heavy."""
ASSESSMENTS = 5
"""Consecutive assessments after an unexpected acceleration; two of them show a torque against its command."""
AGAINST_ASSESSMENTS = 2
JOLT_KEPT = 0.97
"""In 10 ms: a swing of 80 rad/s on a wire with 2 to 3 % of critical damping is a third after half a second."""
LASTING_SHARE = 0.7
"""Share of the lasting limit that must remain a little later for it not to have been a blow; of elastic wires all:
what swings there at first is no blow."""


class SurpriseWatch:
    """Active from the first agitation until the arm follows the model again."""

    def __init__(
        self, joints: Sequence[Witness], limits: Sequence[Thresholds], per_ampere: Sequence[float],
        currents: Sequence[CurrentWatch | None], timing: Timing, expected: ArmExpectation,
        find: Callable[[], Finding | None], report: ArmReport,
    ) -> None:  # fmt: skip
        """`find` tells where the arm may have failed; it takes as long as tens of cycles."""
        self._joints, self._per_ampere, self._limits, self._currents = joints, per_ampere, limits, currents
        self._timing, self._expected, self._find, self._report = timing, expected, find, report
        self._finding: Finding | None = None
        self._begun: list[tuple[float, float, float]] = []
        self._had_stepped: list[bool] = []
        """Which joints' speeds had stepped when the present assessment began."""
        self._at = self._left = 0
        self._applied_nm = [0.0] * len(joints)
        self._against = [0] * len(joints)
        self.calm_until = timing.calm
        """Until this cycle the payload is not known."""
        self._calm_bias = [0.0] * len(joints)
        self._lasting_at = [0] * len(joints)
        self._was_forward = [False] * len(joints)
        self._expected_rad_s = [(0.0, 0.0)] * len(joints)
        self._changes, self._jolts = [0.0] * len(joints), [0.0] * len(joints)
        self._rebounds = [0.0] * len(joints)
        """Of an arm with an elastic wire, rad/s²: it swings back from what was not expected."""
        self._refresh_s = timing.refresh * timing.period_s
        self._motors = [limit.motor_share for limit in limits]
        self.is_open = False

    def turn(self, speed_rad_s: Sequence[float]) -> None:
        """Once in 10 ms: note which joints turn or stand, for their friction is not known, and what jolts the wires."""
        timing = self._timing
        turning_rad_s = sum(map(abs, speed_rad_s))
        for index, (joint, speed, limits) in enumerate(zip(self._joints, speed_rad_s, self._limits, strict=True)):
            joint.turning_rad_s = turning_rad_s
            if not self.is_open:
                joint.learn_lack()
            is_forward = speed > 0.0
            if is_forward is not self._was_forward[index] or -limits.standing < speed < limits.standing:
                self._was_forward[index] = is_forward
                joint.turned_until = joint.cycles + timing.turning
            expected, (last, before) = joint.model_rad_s, self._expected_rad_s[index]
            self._expected_rad_s[index] = expected, last
            lasting, self._changes[index] = self._changes[index], expected - 2.0 * last + before
            jolt = abs(self._changes[index] + lasting) / self._refresh_s
            self._jolts[index] = max(jolt, JOLT_KEPT * self._jolts[index])
            self._rebounds[index] *= JOLT_KEPT

    def _shaken_rad_s2(self, index: int, turned_rad_s2: Sequence[float]) -> float:
        """What elastic wires may make of a joint's acceleration: of its own motor, and of links that it carries.

        A wire passes a change of torque on by and by, and then swings by as much about it.
        """
        row = self._expected.inertia[index]
        own = self._expected.mobility[index][index]
        motor = self._motors[index] if self._joints[index].is_elastic else 0.0
        shaken = 0.0
        for other, (coupling, joint) in enumerate(zip(row, self._joints, strict=True)):
            if not (joint.is_elastic or motor):
                continue
            jolt = self._jolts[other] + turned_rad_s2[other]
            if other == index:
                shaken += jolt * motor
            else:
                shaken += abs(coupling) * own * (jolt * (1.0 + motor) + abs(self._rebounds[other]))
        return shaken

    def open(self, count: int, speed_rad_s: Sequence[float]) -> None:
        """A joint has been agitated in cycle `count`."""
        self._calm_bias = [joint.bias for joint in self._joints]
        self.is_open = True
        self._hear_witnesses()
        self._begin(count, speed_rad_s)

    def cancel(self) -> None:
        """The time between two measurements is not known, so they prove nothing."""
        self.is_open, self._left = False, 0
        for index, joint in enumerate(self._joints):
            joint.is_agitated = False
            self._lasting_at[index] = 0

    def step(self, count: int, speed_rad_s: Sequence[float], acted_nm: Sequence[float], may_stop: bool) -> None:
        """One cycle. `acted_nm` acted since the last."""
        self._hear_witnesses()
        for index, torque_nm in enumerate(acted_nm):
            self._applied_nm[index] += torque_nm
            if self._lasting_at[index] and count >= self._lasting_at[index]:
                self._judge_lasting(index, may_stop)
        is_pending = any(self._lasting_at)
        if self._left <= 0 and not is_pending and not any(joint.is_agitated for joint in self._joints):
            self.is_open = False
        elif count >= self._at:
            self._assess(count, speed_rad_s, may_stop)

    def _hear_witnesses(self) -> None:
        """Where a joint contradicts its model with a living code, the arm has changed, and another's may stand."""
        for joint in self._joints:
            if joint.is_witness:
                for other in self._joints:
                    if other is not joint:
                        other.contested_until = other.cycles + self._timing.stuck_sure

    def _begin(self, count: int, speed_rad_s: Sequence[float]) -> None:
        self._at = count + self._timing.assessed
        self._begun = [
            (speed, joint.model_rad_s, joint.bias) for speed, joint in zip(speed_rad_s, self._joints, strict=True)
        ]
        self._had_stepped = [joint.mode is Mode.STEP for joint in self._joints]
        self._applied_nm = [0.0] * len(self._joints)
        for current in self._currents:
            if current is not None:
                current.mark()

    def _assess(self, count: int, speed_rad_s: Sequence[float], may_stop: bool) -> None:
        """Find missing or excessive torques: the arm's motion in the last cycles, less the model's."""
        is_start = count <= self.calm_until
        is_swinging = count <= self.calm_until + self._timing.swinging - self._timing.calm
        is_unexpected, self._finding = False, None
        elapsed_s = self._timing.assessed_s
        extra = []
        # What steps within an assessment is a sensor or the arm, as is decided elsewhere; the next one begins after it.
        steps = [
            joint.mode is Mode.STEP and not had for joint, had in zip(self._joints, self._had_stepped, strict=True)
        ]
        rows = zip(self._joints, speed_rad_s, self._begun, steps, strict=True)
        for joint, speed, (old_speed, old_model, old_bias), has_stepped in rows:
            off = (speed - old_speed - (joint.model_rad_s - old_model)) / elapsed_s - old_bias
            extra.append(0.0 if joint.mode is Mode.NO_TACHOMETER or has_stepped else off)
            joint.is_agitated = False
        inertia, mobility = self._expected.inertia, self._expected.mobility
        missing_nm = [sum([part * off for part, off in zip(row, extra, strict=True)]) for row in inertia]
        turned = [
            joint.unlearned_friction(joint.turned_until, joint.cycles, limits.turned_nm * mobility[index][index])
            for index, (joint, limits) in enumerate(zip(self._joints, self._limits, strict=True))
        ]
        least_expected = sorted(
            range(len(self._joints)),
            key=lambda index: -abs(missing_nm[index]) * mobility[index][index] / self._limits[index].acceleration,
        )  # the first that is reported is the one that is blamed: of joints that shake each other, the one most astray
        for index in least_expected:
            joint, limits, own = self._joints[index], self._limits[index], mobility[index][index]
            unexpected = missing_nm[index] * own
            if joint.mode not in (Mode.SOUND, Mode.STEP) or steps[index]:
                continue
            excused = turned[index] + self._shaken_rad_s2(index, turned) + joint.behind_rad_s2
            if unexpected * self._rebounds[index] < 0.0:
                excused += abs(self._rebounds[index])
            may_judge = may_stop and not is_start and abs(unexpected) > excused
            self._judge_direction(index, missing_nm[index], self._begun[index][2] / own, may_judge)
            allowed = limits.start_acceleration if is_swinging else limits.acceleration * joint.noisiness
            if abs(unexpected) > allowed + excused and not joint.accuse_code():
                is_unexpected = True
                if any(each.is_elastic for each in self._joints):
                    self._rebounds[index] = unexpected
                worth_a = missing_nm[index] / self._per_ampere[index]
                detail = f"{unexpected:+.0f} rad/s2 beyond the model, {worth_a:+.2f} A worth of torque"
                current = self._currents[index]
                is_shown = current is not None and may_judge and current.shows(missing_nm[index])
                if not (is_shown and self._report("current-mismatch", index, f"{detail}, as its sense shows", None)):
                    self._accuse(index, detail)
                if joint.mode is Mode.SOUND:
                    share = 1.0 + self._motors[index] if joint.is_elastic else 1.0
                    joint.settle(extra[index] / share - (joint.bias - self._begun[index][2]))
            if not may_stop:
                self._calm_bias[index], self._lasting_at[index] = joint.bias, 0
            elif abs(joint.bias - self._calm_bias[index]) > limits.lasting and not is_swinging:
                self._lasting_at[index] = self._lasting_at[index] or count + self._timing.lasting
        self._left = ASSESSMENTS if is_unexpected else self._left - 1
        self._begin(count, speed_rad_s)

    def _judge_direction(self, index: int, off_nm: float, lacking_nm: float, may_stop: bool) -> None:
        """Whether twice the commanded torque is missing, in total since the model last fitted, or suddenly."""
        per_ampere, limits = self._per_ampere[index], self._limits[index]
        command_nm = self._applied_nm[index] / self._timing.assessed
        total_nm = off_nm + lacking_nm
        share = -total_nm / command_nm if abs(command_nm) > limits.told_current * per_ampere else 0.0
        is_against = WRONG_DIRECTION[0] < share < WRONG_DIRECTION[1] and may_stop
        self._against[index] = self._against[index] + 1 if is_against else 0
        sudden = -off_nm / command_nm if abs(command_nm) > limits.sudden_current * per_ampere else 0.0
        if WRONG_DIRECTION[0] < sudden < WRONG_DIRECTION[1] and may_stop:
            self._against[index] = AGAINST_ASSESSMENTS
        if self._against[index] >= AGAINST_ASSESSMENTS and not self._is_arm(index):
            command_a = command_nm / per_ampere
            text = f"{total_nm / per_ampere:+.2f} A worth of torque beyond the {command_a:+.2f} A commanded"
            self._report("wrong-direction", index, text, None)

    def _found(self) -> Finding | None:
        """Once an assessment, as far as it is asked for."""
        finding = self._finding = self._finding or self._find()
        return finding

    def _is_arm(self, index: int) -> bool:
        """Whether it is not the bridge of a joint."""
        finding = self._found()
        return finding is not None and finding.is_not_reversed(index)

    def _accuse(self, index: int, detail: str) -> None:
        """Report what is unexpected of a joint: of the one that it comes from, if that is another."""
        finding = self._found()
        if finding is not None and (other := finding.rather_than(index)) is not None:
            self._report("acceleration-mismatch", other, f"its link or wire: another joint has {detail}", None)
        self._report("acceleration-mismatch", index, detail, None)

    def _judge_lasting(self, index: int, may_stop: bool) -> None:
        """Whether an acceleration beyond any payload persists."""
        self._lasting_at[index] = 0
        change = self._joints[index].bias - self._calm_bias[index]
        share = 1.0 if any(joint.is_elastic for joint in self._joints) else LASTING_SHARE
        if abs(change) > share * self._limits[index].lasting and may_stop:
            detail = f"{change:+.0f} rad/s2 beyond the model, more than any payload, and lasting"
            self._report("acceleration-mismatch", index, detail, Reaction.OFF)
