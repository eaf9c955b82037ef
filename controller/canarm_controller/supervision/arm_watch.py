"""The whole arm against its nominal model: joins the watches of joints, currents, surprises and the following error.

Owns the model's accelerations in the cycle. Frames and states of a run must not enter. Everything is judged by
measurements and commands; the truth is not known here.
"""

from collections.abc import Callable, Sequence

from canarm_protocol.cell.model import Cell, Quantity
from canarm_protocol.cell.wiring import sensor_scale

from ..dynamics import Arm
from ..laws.base import Cycle
from .currents import CurrentWatch
from .detection import Reaction
from .following import FollowingWatch
from .joint_state import Mode
from .limits import Report
from .surprise import ArmReport, SurpriseWatch
from .witness import LONGEST_GAP_S, JointWitness

REFRESH_CYCLES = 4
"""Gravity, Coriolis, friction and inertia are evaluated every fourth cycle: at 2.5 rad/s the arm turns 1.4° meanwhile,
and gravity changes by 2.5 %."""
REST = (0.0, 0.0)


class ArmWatch:
    """State of all joints' residuals. `step` may put substitutes in place of the cycle's measurements."""

    def __init__(
        self, cell: Cell, arm: Arm, skew_s: Callable[[int, Quantity], float], following_lsb: float,
        report: ArmReport,
    ) -> None:  # fmt: skip
        self._arm, period_s = arm, cell.bus.cycle_s
        self._report = report
        limits = cell.supervision
        positions_lsb = [sensor_scale(joint, Quantity.POSITION).lsb for joint in cell.joints]
        speeds_lsb = [sensor_scale(joint, Quantity.VELOCITY).lsb for joint in cell.joints]
        self.joints: list[JointWitness] = []
        self.currents: list[CurrentWatch] = []
        for index, joint in enumerate(cell.joints):
            tell = self._teller(index)
            skew = skew_s(index, Quantity.VELOCITY)
            self.joints.append(JointWitness(limits, positions_lsb[index], speeds_lsb[index], skew, period_s, tell))
            skew = skew_s(index, Quantity.CURRENT)
            self.currents.append(CurrentWatch(joint, limits, skew, speeds_lsb[index], period_s, tell))
        self._surprise = SurpriseWatch(
            self.joints, arm.torque_per_ampere, limits.acceleration_mismatch_rad_s2, period_s, report
        )
        self._following = FollowingWatch(
            cell, following_lsb, positions_lsb, report, lambda index: self.joints[index].is_upset, self._may_saturate
        )
        self._refresh_at = 0
        self._cycle = 0
        self._last_nm: Sequence[float] = (0.0,) * len(self.joints)

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
        (last1, last2), (still1, still2) = last_nm, self._still_nm
        left1, left2 = last1 - still1, last2 - still2
        measured_rad_s = cycle.velocity_rad_s
        (x1, x2), (v1, v2) = cycle.position_rad, measured_rad_s
        replaced1 = first.step(x1, v1, own1 * left1 + cross * left2, angle_codes[0], speed_codes[0])
        replaced2 = second.step(x2, v2, cross * left1 + own2 * left2, angle_codes[1], speed_codes[1])
        first_a, second_a = self.currents
        count = self._cycle = self._cycle + 1
        is_odd = count & 1
        if (is_odd or first_a.cycles) and (off_a := first_a.differs(current_codes[0], applied_nm[0], last1, v1)):
            first_a.judge(off_a, v1, first.model_rad_s, first.bias, own1)
        if (not is_odd or second_a.cycles) and (off_a := second_a.differs(current_codes[1], applied_nm[1], last2, v2)):
            second_a.judge(off_a, v2, second.model_rad_s, second.bias, own2)
        if replaced1 or replaced2:
            self._replace(cycle, replaced1, replaced2)
        if count >= self._refresh_at:
            self._refresh(cycle.position_rad, (first.speed, second.speed))
        surprise = self._surprise
        if surprise.is_open:
            may_stop = count > self._following.forgiven_until
            surprise.step(count, measured_rad_s, last_nm, self._inertia, self._inverse, may_stop)
        elif first.is_agitated or second.is_agitated:
            surprise.open(count, measured_rad_s)

    def follow(self, cycle: Cycle) -> None:
        """Judge the following error of one cycle, once its reference is known."""
        self._following.step(self._cycle, cycle)

    def coast(self, cycle: Cycle) -> None:
        """A cycle without measurements: the arm goes on as the model says, and the law is given that."""
        first, second = self.joints
        acceleration1, acceleration2 = self._accelerations()
        self._last_nm = cycle.applied_nm
        self._cycle += 1
        first.coast(acceleration1)
        second.coast(acceleration2)
        self._surprise.cancel()
        self._following.gap(self._cycle)
        self._replace(cycle, True, True)
        if self._cycle >= self._refresh_at:
            self._refresh(cycle.position_rad, cycle.velocity_rad_s)

    def shift(self, excess_s: float) -> None:
        """More time than a cycle has passed since the last measurement, or less."""
        for joint, acceleration in zip(self.joints, self._accelerations(), strict=True):
            joint.shift(excess_s, acceleration)

    def glimpse(
        self, cycle: Cycle, angle_codes: Sequence[int], speed_codes: Sequence[int], excess_s: float, is_unclear: bool
    ) -> None:
        """As `step` for measurements whose time is known badly: `excess_s` more than a cycle after the last.

        `is_unclear`: not even that is known.
        """
        is_gap = is_unclear or not -LONGEST_GAP_S < excess_s < LONGEST_GAP_S
        if not is_gap:
            self.shift(excess_s)
        accelerations = self._accelerations()
        self._last_nm = cycle.applied_nm
        self._cycle += 1
        rows = zip(cycle.position_rad, cycle.velocity_rad_s, accelerations, angle_codes, speed_codes, strict=True)
        replaced = [joint.glimpse(*row, is_gap) for joint, row in zip(self.joints, rows, strict=True)]
        self._replace(cycle, *replaced)
        for current in self.currents:
            current.forget()
        self._surprise.cancel()
        self._following.gap(self._cycle)
        self._refresh(cycle.position_rad, [joint.speed for joint in self.joints])

    def _replace(self, cycle: Cycle, first_is_replaced: bool, second_is_replaced: bool) -> None:
        first, second = self.joints
        (x1, x2), (v1, v2) = cycle.position_rad, cycle.velocity_rad_s
        if first_is_replaced:
            x1, v1 = first.position_rad, first.velocity_rad_s
        if second_is_replaced:
            x2, v2 = second.position_rad, second.velocity_rad_s
        cycle.position_rad, cycle.velocity_rad_s = (x1, x2), (v1, v2)

    def _accelerations(self) -> tuple[float, float]:
        """What the model makes of the last torques, rad/s²."""
        own1, cross, own2 = self._inverse
        left1, left2 = self._last_nm[0] - self._still_nm[0], self._last_nm[1] - self._still_nm[1]
        return own1 * left1 + cross * left2, cross * left1 + own2 * left2

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

    def _may_saturate(self, index: int) -> bool:
        """Whether an amplifier at its limit is an excuse: not if something is wrong with sensors or current as well."""
        return self.joints[index].mode is Mode.SOUND and not self.currents[index].is_given_up

    def _teller(self, index: int) -> Report:
        def tell(detector: str, detail: str, reaction: Reaction | None) -> bool:
            if detector == "overspeed" and self._cycle <= self._following.forgiven_until:
                reaction = Reaction.DEGRADED  # flung by a payload that fell off: the amplifier was at its limit
            return self._report(detector, index, detail, reaction)

        return tell
