"""The whole arm against its nominal model: joins the joints' witnesses, finds torques that nobody commanded.

Owns the model's accelerations in the cycle, the following error and saturation. Frames and states of a run must not
enter. Everything is judged by measurements and commands; the truth is not known here.
"""

from collections.abc import Callable, Sequence

from canarm_protocol.cell import Cell, Quantity
from canarm_protocol.wiring import sensor_scale

from ..dynamics import NominalArm
from ..laws.base import Cycle
from .currents import CurrentWatch
from .detection import Reaction
from .witness import CALM_CYCLES, JointWitness, Mode, Report

ArmReport = Callable[[str, int, str, Reaction | None], bool]
"""Detector, index of the joint, detail and, where it is not the table's, the reaction."""

REFRESH_CYCLES = 4
"""Gravity, Coriolis, friction and inertia are evaluated every fourth cycle: at 2.5 rad/s the arm turns 1.4° meanwhile,
and gravity changes by 2.5 %."""
ASSESSED_CYCLES = 4
"""Over which an unexpected acceleration is measured: readings of the tachometer 10 ms apart tell it to 1.2 rad/s²."""
WRONG_DIRECTION = 1.5, 2.6
"""Missing over commanded torque: 2 for a reversed bridge, 1 for none, at most 1 for a payload twice as heavy."""
SMALLEST_CURRENT_A, SUDDEN_CURRENT_A = 0.08, 0.12
"""The share is told from noise above the first; above the second a sudden one is believed at once."""
ASSESSMENTS = 5
"""In a row, once something is unexpected: whether a torque is against its command shows in two of them."""
START_FACTOR = 4.0
"""While the arm leaves its support, an elastic wire takes up its weight, and the payload is not known."""
NORMAL_FACTOR, JAMMED_CYCLES = 2.0, 20
"""A following error is abnormal at twice what is normal; a joint that does not even move then is jammed."""
STANDING_RAD_S = 0.06
AGAINST_ASSESSMENTS = 2
JUDGED_AT_RAD_S = 12.0
"""Natural frequency at which laws state their normal following error; a softer loop lags by its inverse square more."""
BEGINNING_CYCLES = 200
"""Half a second in which a law learns what the arm carries: a payload that sags then is no failure."""
REST, UNSATURATED = (0.0, 0.0), (False, False)
FOLLOWING_CYCLES, SATURATED_CYCLES, RECOVERY_CYCLES = 4, 40, 800
"""A following error must grow for so long; an amplifier be at its limit for so long; and after that the arm has 2 s to
come back."""


class ArmWatch:
    """State of all joints' residuals. `step` may put substitutes in place of the cycle's measurements."""

    def __init__(
        self, cell: Cell, arm: NominalArm, skew_s: Callable[[int, Quantity], float], following_lsb: float,
        report: ArmReport,
    ) -> None:  # fmt: skip
        self._arm, self._period_s = arm, cell.bus.cycle_s
        self._report = report
        limits, period_s = cell.supervision, self._period_s
        self._unexpected_rad_s2 = limits.acceleration_mismatch_rad_s2
        self._positions_lsb = [sensor_scale(joint, Quantity.POTENTIOMETER).step for joint in cell.joints]
        softness = max(1.0, JUDGED_AT_RAD_S / cell.control.natural_frequency_rad_s) ** 2
        self._following_rad = [NORMAL_FACTOR * softness * following_lsb * lsb for lsb in self._positions_lsb]
        speeds_lsb = [sensor_scale(joint, Quantity.TACHOMETER).step for joint in cell.joints]
        self.joints: list[JointWitness] = []
        self.currents: list[CurrentWatch] = []
        for index, joint in enumerate(cell.joints):
            tell = self._teller(index)
            self.joints.append(
                JointWitness(
                    limits, self._positions_lsb[index], speeds_lsb[index],
                    skew_s(index, Quantity.TACHOMETER), period_s, tell,
                )
            )  # fmt: skip
            skew = skew_s(index, Quantity.CURRENT_SENSE)
            self.currents.append(CurrentWatch(joint, limits, skew, speeds_lsb[index], period_s, tell))
        self._per_ampere = arm.torque_per_ampere
        self._refresh_at = 0
        self._cycle = 0
        self._last_nm: Sequence[float] = (0.0,) * len(self.joints)
        self._assess_from: list[tuple[float, float, float]] = []
        self._assess_at = self._assessments = 0
        self._against = [0] * len(self.joints)
        self._following = [0] * len(self.joints)
        self._saturated = [0] * len(self.joints)
        self._jammed = [0] * len(self.joints)
        self._forgiven_until = -1

    def start(self, position_rad: Sequence[float]) -> None:
        """The arm rests at this pose; no torque acts yet."""
        for joint, position in zip(self.joints, position_rad, strict=True):
            joint.start(position)
        self._refresh(position_rad, (0.0,) * len(self.joints))

    def step(
        self, cycle: Cycle, angle_codes: Sequence[int], speed_codes: Sequence[int], current_codes: Sequence[int]
    ) -> None:
        """Judge the measurements of one cycle, before the law sees them. `cycle.applied_nm` acts from this SYNC on."""
        first, second = self.joints
        last_nm = self._last_nm
        applied_nm = self._last_nm = cycle.applied_nm
        own1, cross, own2 = self._inverse
        left1, left2 = last_nm[0] - self._still_nm[0], last_nm[1] - self._still_nm[1]
        (x1, x2), (v1, v2) = cycle.position_rad, cycle.velocity_rad_s
        measured_rad_s = cycle.velocity_rad_s
        replaced1 = first.step(x1, v1, own1 * left1 + cross * left2, angle_codes[0], speed_codes[0])
        replaced2 = second.step(x2, v2, cross * left1 + own2 * left2, angle_codes[1], speed_codes[1])
        first_a, second_a = self.currents
        count = self._cycle = self._cycle + 1
        is_odd = count & 1
        if (is_odd or first_a.cycles) and (off_a := first_a.differs(current_codes[0], applied_nm[0], last_nm[0], v1)):
            first_a.judge(off_a, v1, first.model_rad_s, first.bias, own1)
        if (not is_odd or second_a.cycles) and (
            off_a := second_a.differs(current_codes[1], applied_nm[1], last_nm[1], v2)
        ):
            second_a.judge(off_a, v2, second.model_rad_s, second.bias, own2)
        if replaced1 or replaced2:
            if replaced1:
                x1, v1 = first.position_rad, first.velocity_rad_s
            if replaced2:
                x2, v2 = second.position_rad, second.velocity_rad_s
            cycle.position_rad, cycle.velocity_rad_s = (x1, x2), (v1, v2)
        if count >= self._refresh_at:
            self._refresh((x1, x2), (first.speed, second.speed))
        if self._assess_at:
            if not (first.is_agitated or second.is_agitated or self._assessments > 0):
                self._assess_at = 0
            elif count >= self._assess_at:
                self._assess(measured_rad_s, applied_nm)
        elif first.is_agitated or second.is_agitated:
            self._begin_assessment(measured_rad_s)

    def follow(self, cycle: Cycle) -> None:
        """Judge the following error of one cycle, once its reference is known."""
        (x1, x2), (wanted1, wanted2), (limit1, limit2) = cycle.position_rad, cycle.reference_rad, self._following_rad
        if -limit1 < x1 - wanted1 < limit1 and -limit2 < x2 - wanted2 < limit2 and cycle.saturated == UNSATURATED:
            self._following[0] = self._following[1] = 0
            return
        for index, (position, reference) in enumerate(zip(cycle.position_rad, cycle.reference_rad, strict=True)):
            error = position - reference
            limit = self._following_rad[index]
            if -limit < error < limit:
                self._following[index] = 0
                if cycle.saturated[index]:
                    self._excuse(index)
                continue
            self._lag(index, cycle, error)

    def coast(self, cycle: Cycle) -> None:
        """A cycle without measurements: the arm goes on as the model says, and the law is given that."""
        own1, cross, own2 = self._inverse
        left1, left2 = self._last_nm[0] - self._still_nm[0], self._last_nm[1] - self._still_nm[1]
        self._last_nm = cycle.applied_nm
        self._cycle += 1
        first, second = self.joints
        first.coast(own1 * left1 + cross * left2)
        second.coast(cross * left1 + own2 * left2)
        cycle.position_rad = first.position_rad, second.position_rad
        cycle.velocity_rad_s = first.velocity_rad_s, second.velocity_rad_s

    def _refresh(self, position_rad: Sequence[float], speed_rad_s: Sequence[float]) -> None:
        arm = self._arm
        self._refresh_at = self._cycle + REFRESH_CYCLES
        self._still_nm = arm.torque_nm(position_rad, speed_rad_s, REST)
        (d11, d12), (_, d22) = arm.inertia(position_rad)
        d11 += arm.rotor_inertia[0]
        d22 += arm.rotor_inertia[1]
        determinant = d11 * d22 - d12 * d12
        self._inertia = d11, d12, d22
        self._inverse = d22 / determinant, -d12 / determinant, d11 / determinant

    def _begin_assessment(self, speed_rad_s: Sequence[float]) -> None:
        self._assess_at = self._cycle + ASSESSED_CYCLES
        self._assess_from = [
            (speed, joint.model_rad_s, joint.bias) for speed, joint in zip(speed_rad_s, self.joints, strict=True)
        ]

    def _assess(self, speed_rad_s: Sequence[float], applied_nm: Sequence[float]) -> None:
        """Which torques are missing or too much: what the arm did in the last cycles, less what the model says."""
        self._assess_at = 0
        is_start = self._cycle <= CALM_CYCLES
        may_stop = not is_start and self._cycle > self._forgiven_until
        limit = self._unexpected_rad_s2 * (START_FACTOR if is_start else 1.0)
        is_unexpected = False
        elapsed_s = ASSESSED_CYCLES * self._period_s
        extra = []
        for joint, speed, (old_speed, old_model, old_bias) in zip(
            self.joints, speed_rad_s, self._assess_from, strict=True
        ):
            off = (speed - old_speed - (joint.model_rad_s - old_model)) / elapsed_s - old_bias
            extra.append(0.0 if joint.mode is Mode.NO_TACHOMETER else off)
            joint.is_agitated = False
        d11, d12, d22 = self._inertia
        missing_nm = d11 * extra[0] + d12 * extra[1], d12 * extra[0] + d22 * extra[1]
        for index, joint in enumerate(self.joints):
            command_nm, off_nm, per_ampere = applied_nm[index], missing_nm[index], self._per_ampere[index]
            unexpected = off_nm * self._inverse[2 * index]
            if joint.mode not in (Mode.SOUND, Mode.STEP):
                continue
            total_nm = off_nm + self._assess_from[index][2] / self._inverse[2 * index]
            share = -total_nm / command_nm if abs(command_nm) > SMALLEST_CURRENT_A * per_ampere else 0.0
            is_against = WRONG_DIRECTION[0] < share < WRONG_DIRECTION[1] and may_stop
            self._against[index] = self._against[index] + 1 if is_against else 0
            sudden = -off_nm / command_nm if abs(command_nm) > SUDDEN_CURRENT_A * per_ampere else 0.0
            if WRONG_DIRECTION[0] < sudden < WRONG_DIRECTION[1] and may_stop:
                self._against[index] = AGAINST_ASSESSMENTS
            detail = f"{unexpected:+.0f} rad/s2 beyond the model, {off_nm / per_ampere:+.2f} A worth of torque"
            if self._against[index] >= AGAINST_ASSESSMENTS:
                command_a = command_nm / per_ampere
                text = f"{total_nm / per_ampere:+.2f} A worth of torque beyond the {command_a:+.2f} A commanded"
                self._report("wrong-direction", index, text, None)
            if abs(unexpected) > limit:
                is_unexpected = True
                self._report("acceleration-mismatch", index, detail, None)
                if joint.mode is Mode.SOUND:
                    joint.settle(extra[index] - (joint.bias - self._assess_from[index][2]))
        self._assessments = ASSESSMENTS if is_unexpected else self._assessments - 1
        if self._assessments > 0:
            self._begin_assessment(speed_rad_s)

    def _lag(self, index: int, cycle: Cycle, error: float) -> None:
        """The joint is further from its reference than is normal for the law."""
        detail = f"{error / self._positions_lsb[index]:+.1f} LSB from the reference"
        if cycle.saturated[index] and self._may_saturate(index):
            self._excuse(index)
            if self._saturated[index] == SATURATED_CYCLES:
                self._report("saturation", index, f"amplifier at its limit, {detail}", None)
            stands = abs(cycle.velocity_rad_s[index]) < STANDING_RAD_S and self.joints[index].is_upset
            self._jammed[index] = self._jammed[index] + 1 if stands else 0
            if self._jammed[index] >= JAMMED_CYCLES:
                self._report("following-error", index, f"{detail}, and all current does not move it", None)
            return
        self._saturated[index] = 0
        rate = cycle.velocity_rad_s[index] - cycle.reference_rad_s[index]
        is_growing = error * rate > 0.0 or abs(rate) < STANDING_RAD_S
        self._following[index] += 1 if is_growing else 0
        if self._following[index] >= FOLLOWING_CYCLES and self._cycle > max(self._forgiven_until, BEGINNING_CYCLES):
            self._report("following-error", index, detail, None)

    def _excuse(self, index: int) -> None:
        """The amplifier has been at its limit for long enough to excuse what follows."""
        self._saturated[index] += 1
        if self._saturated[index] >= SATURATED_CYCLES and self._may_saturate(index):
            self._forgiven_until = self._cycle + RECOVERY_CYCLES

    def _may_saturate(self, index: int) -> bool:
        """Whether an amplifier at its limit is an excuse: not if something is wrong with sensors or current as well."""
        return self.joints[index].mode is Mode.SOUND and not self.currents[index].is_given_up

    def resume(self, cycle: Cycle) -> None:
        """The time since the last measurement is not known: begin at this one."""
        for joint, position, speed in zip(self.joints, cycle.position_rad, cycle.velocity_rad_s, strict=True):
            joint.resume(position, speed)
        self._last_nm = cycle.applied_nm
        self._cycle += 1

    def _teller(self, index: int) -> Report:
        def tell(detector: str, detail: str, reaction: Reaction | None) -> bool:
            if detector == "overspeed" and self._cycle <= self._forgiven_until:
                reaction = Reaction.DEGRADED  # flung by a payload that fell off: the amplifier was at its limit
            return self._report(detector, index, detail, reaction)

        return tell
