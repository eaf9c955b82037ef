"""Accelerations that the model did not expect: which torque is missing or too much, and is it the drive's?

Owns what is measured over a few cycles after a joint's witness has been agitated. The cycle's own residuals must not
enter.
"""

from collections.abc import Callable, Sequence

from .detection import Reaction
from .joint_state import CALM_CYCLES, Mode
from .witness import JointWitness

ArmReport = Callable[[str, int, str, Reaction | None], bool]
"""Detector, index of the joint, detail and, where it is not the table's, the reaction."""

ASSESSED_CYCLES = 4
"""Over which an unexpected acceleration is measured: readings of the tachometer 10 ms apart tell it to 1.2 rad/s²."""
WRONG_DIRECTION = 1.5, 2.6
"""Missing over commanded torque: 2 for a reversed bridge, 1 for none, at most 1 for a payload twice as heavy."""
SMALLEST_CURRENT_A, SUDDEN_CURRENT_A = 0.08, 0.12
"""The share is told from noise above the first; above the second a sudden one is believed at once."""
ASSESSMENTS = 5
"""In a row, once something is unexpected: whether a torque is against its command shows in two of them."""
AGAINST_ASSESSMENTS = 2
START_FACTOR = 4.0
"""While the arm leaves its support, an elastic wire takes up its weight, and the payload is not known."""
BEYOND_PAYLOAD_RAD_S2, LASTING_SHARE, LASTING_CYCLES = 20.0, 0.7, 10
"""A payload that changes by half of the link makes 7 rad/s² and one of 0.3 kg at its end 14; what is more than that and
has not gone by 25 ms later, as a blow has, is a jam or a drive that brakes."""


class SurpriseWatch:
    """From the first agitation until the arm does again what the model expects."""

    def __init__(
        self, joints: Sequence[JointWitness], per_ampere: Sequence[float], limit_rad_s2: float, period_s: float,
        report: ArmReport,
    ) -> None:  # fmt: skip
        self._joints, self._per_ampere = joints, per_ampere
        self._limit_rad_s2, self._period_s = limit_rad_s2, period_s
        self._report = report
        self._begun: list[tuple[float, float, float]] = []
        self._at = self._left = 0
        self._applied_nm = [0.0] * len(joints)
        self._against = [0] * len(joints)
        self._calm_bias = [0.0] * len(joints)
        self._lasting_at = [0] * len(joints)
        self.is_open = False

    def open(self, count: int, speed_rad_s: Sequence[float]) -> None:
        """A joint has been agitated in cycle `count`."""
        self._calm_bias = [joint.bias for joint in self._joints]
        self.is_open = True
        self._begin(count, speed_rad_s)

    def cancel(self) -> None:
        """The time between two measurements is not known: nothing can be told from these."""
        self.is_open, self._left = False, 0
        for index, joint in enumerate(self._joints):
            joint.is_agitated = False
            self._lasting_at[index] = 0

    def step(
        self, count: int, speed_rad_s: Sequence[float], acted_nm: Sequence[float],
        inertia: tuple[float, float, float], mobility: tuple[float, float, float], may_stop: bool,
    ) -> None:  # fmt: skip
        """One cycle. `acted_nm` acted since the last; `inertia` and its inverse as (11, 12, 22)."""
        for index, torque_nm in enumerate(acted_nm):
            self._applied_nm[index] += torque_nm
            if self._lasting_at[index] and count >= self._lasting_at[index]:
                self._judge_lasting(index, may_stop)
        is_pending = any(self._lasting_at)
        if self._left <= 0 and not is_pending and not any(joint.is_agitated for joint in self._joints):
            self.is_open = False
        elif count >= self._at:
            self._assess(count, speed_rad_s, inertia, mobility, may_stop)

    def _begin(self, count: int, speed_rad_s: Sequence[float]) -> None:
        self._at = count + ASSESSED_CYCLES
        self._begun = [
            (speed, joint.model_rad_s, joint.bias) for speed, joint in zip(speed_rad_s, self._joints, strict=True)
        ]
        self._applied_nm = [0.0] * len(self._joints)

    def _assess(
        self, count: int, speed_rad_s: Sequence[float], inertia: tuple[float, float, float],
        mobility: tuple[float, float, float], may_stop: bool,
    ) -> None:  # fmt: skip
        """Which torques are missing or too much: what the arm did in the last cycles, less what the model says."""
        is_start = count <= CALM_CYCLES
        limit = self._limit_rad_s2 * (START_FACTOR if is_start else 1.0)
        is_unexpected = False
        elapsed_s = ASSESSED_CYCLES * self._period_s
        extra = []
        for joint, speed, (old_speed, old_model, old_bias) in zip(self._joints, speed_rad_s, self._begun, strict=True):
            off = (speed - old_speed - (joint.model_rad_s - old_model)) / elapsed_s - old_bias
            extra.append(0.0 if joint.mode is Mode.NO_TACHOMETER else off)
            joint.is_agitated = False
        d11, d12, d22 = inertia
        missing_nm = d11 * extra[0] + d12 * extra[1], d12 * extra[0] + d22 * extra[1]
        for index, joint in enumerate(self._joints):
            own = mobility[2 * index]
            unexpected = missing_nm[index] * own
            if joint.mode not in (Mode.SOUND, Mode.STEP):
                continue
            self._judge_direction(index, missing_nm[index], self._begun[index][2] / own, may_stop and not is_start)
            if abs(unexpected) > limit:
                is_unexpected = True
                worth_a = missing_nm[index] / self._per_ampere[index]
                detail = f"{unexpected:+.0f} rad/s2 beyond the model, {worth_a:+.2f} A worth of torque"
                self._report("acceleration-mismatch", index, detail, None)
                if joint.mode is Mode.SOUND:
                    joint.settle(extra[index] - (joint.bias - self._begun[index][2]))
            if not may_stop:
                self._calm_bias[index], self._lasting_at[index] = joint.bias, 0
            elif abs(joint.bias - self._calm_bias[index]) > BEYOND_PAYLOAD_RAD_S2 and not is_start:
                self._lasting_at[index] = self._lasting_at[index] or count + LASTING_CYCLES
        self._left = ASSESSMENTS if is_unexpected else self._left - 1
        self._begin(count, speed_rad_s)

    def _judge_direction(self, index: int, off_nm: float, lacking_nm: float, may_stop: bool) -> None:
        """Whether twice the commanded torque is missing: of all since the model last fitted, or of what is sudden."""
        per_ampere = self._per_ampere[index]
        command_nm = self._applied_nm[index] / ASSESSED_CYCLES
        total_nm = off_nm + lacking_nm
        share = -total_nm / command_nm if abs(command_nm) > SMALLEST_CURRENT_A * per_ampere else 0.0
        is_against = WRONG_DIRECTION[0] < share < WRONG_DIRECTION[1] and may_stop
        self._against[index] = self._against[index] + 1 if is_against else 0
        sudden = -off_nm / command_nm if abs(command_nm) > SUDDEN_CURRENT_A * per_ampere else 0.0
        if WRONG_DIRECTION[0] < sudden < WRONG_DIRECTION[1] and may_stop:
            self._against[index] = AGAINST_ASSESSMENTS
        if self._against[index] >= AGAINST_ASSESSMENTS:
            command_a = command_nm / per_ampere
            text = f"{total_nm / per_ampere:+.2f} A worth of torque beyond the {command_a:+.2f} A commanded"
            self._report("wrong-direction", index, text, None)

    def _judge_lasting(self, index: int, may_stop: bool) -> None:
        """Whether what was beyond any payload is still there."""
        self._lasting_at[index] = 0
        change = self._joints[index].bias - self._calm_bias[index]
        if abs(change) > LASTING_SHARE * BEYOND_PAYLOAD_RAD_S2 and may_stop:
            detail = f"{change:+.0f} rad/s2 beyond the model, more than any payload, and lasting"
            self._report("acceleration-mismatch", index, detail, Reaction.OFF)
