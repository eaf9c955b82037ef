"""All joints against their nominal model: joins the watches of joints, currents, surprises and the following error.

Owns the order of events in a cycle; frames and run states are not known here. Everything is judged by measurements and
commands; the truth is not known here.
"""

import math
from collections import deque
from collections.abc import Callable, Collection, Sequence

from canarm_protocol.cell.model import Cell

from ..dynamics import Arm, ClosedChain, HeldMotion, SeveralArms
from ..laws.base import Cycle
from .blame import PAST_CYCLES, Moment
from .currents import CurrentWatch
from .detection import Reaction, named_for
from .following import FollowingWatch, normal_rad
from .grip_watch import GripWatch, grip_limits
from .hold import SafeHold
from .joint_state import Mode
from .limits import Report
from .load import Load
from .nominal import joint_nominals
from .overdue import CountWatch
from .robot_watch import RobotWatch
from .start_pose import StartPose
from .stops import Stops, held
from .supply import Supply
from .support import Support
from .surprise import ArmReport, Witness
from .tachless import TachlessWitness
from .thresholds import cell_thresholds
from .timing import Timing
from .witness import LONGEST_GAP_S, JointWitness

Accelerate = Callable[[Sequence[float]], Sequence[float]]

OF_A_STEP = ("tachometer-jump", "tachometer-spike", "tachometer-range")
"""Speeds that step. If the arm itself did, a jump is believed, but not what came and went or is at the end of codes."""
SETTLED_REFRESHES = 25
"""What the model lacks is known from so many of the watch's refreshes ago, 0.25 s: before whatever has just failed."""
FORGOTTEN = 0.01
"""If at most this share of a change of current is left one cycle later, the winding's lag is neglected."""


class ArmWatch:
    """State of all joints' residuals. `step` may replace the cycle's measurements."""

    def __init__(
        self, cell: Cell, arm: Arm, following_lsb: float, report: ArmReport, *, bears_weight: bool = True
    ) -> None:
        """`following_lsb` is the law's; not `bears_weight`: neither law nor feed-forward knows the arm's weight."""
        self._arm, self._timing = arm, Timing.of(cell.bus.cycle_s)
        parts = arm.parts if isinstance(arm, SeveralArms) else (arm,)
        timing = self._timing
        self._nominals = joint_nominals(cell, parts)
        self._load = Load.of(cell, arm)
        self._pose = StartPose(cell, self._nominals, timing)
        report = self._report = self._pose.naming(report)
        limits = cell_thresholds(self._nominals, cell.supervision, timing)
        chain = ClosedChain.of(cell)
        self.grips: GripWatch | None = None
        """The hands that hold an object; None without one."""
        if chain is not None:
            self.grips = GripWatch(chain, grip_limits(cell, chain, self._nominals), timing.period_s)
        self.standing_rad_s = [limit.standing for limit in limits]
        """Speeds below which the joints stand still."""
        self.joints: list[Witness] = []
        self.currents: list[CurrentWatch | None] = []
        for index, (nominal, limit) in enumerate(zip(self._nominals, limits, strict=True)):
            tell = self._teller(index)
            kind = TachlessWitness if nominal.speed is None else JointWitness
            self.joints.append(kind(nominal, limit, timing, tell))
            sense = nominal.current
            self.currents.append(None if sense is None else CurrentWatch(nominal, sense, limit, timing, tell))
        self._counts = CountWatch(self.joints, self._nominals, timing, self._accuse_count)
        self._pair = (self.joints[0], self.joints[1]) if len(self.joints) == 2 else None
        self._senses = [(index, current) for index, current in enumerate(self.currents) if current is not None]
        self._past: deque[Moment] = deque(maxlen=PAST_CYCLES)
        self._robots: list[RobotWatch] = []
        first = 0
        for part in parts:
            joints = slice(first, first + part.joint_count)
            own = self.joints[joints], self.currents[joints], self._nominals[joints], limits[joints]
            self._robots.append(RobotWatch(part, joints, *own, timing, self._past, report))
            first = joints.stop
        self._robot_of = [robot for robot in self._robots for _ in range(robot.joints.start, robot.joints.stop)]
        self._is_surprised = False
        only = len(self._robots) == 1
        self._accelerate: Accelerate = self._robots[0].expected.accelerations if only else self._accelerate_all
        self._held = None if chain is None else HeldMotion(chain)
        self._following = FollowingWatch(
            [cell.control.of_joint(name).natural_frequency_rad_s for name in cell.joint_names],
            [normal_rad(*each, following_lsb, bears_weight) for each in zip(self._nominals, limits, strict=True)],
            limits,
            [nominal.position.step for nominal in self._nominals], timing, report,
            lambda index: self.joints[index].is_upset, self._may_saturate,
        )  # fmt: skip
        decays = [math.exp(-timing.period_s / nominal.winding_s) for nominal in self._nominals]
        self._decays = decays if self._senses and max(decays) > FORGOTTEN else None
        self._refresh_at = 0
        self._keeps = [robot.holds for robot in cell.robot for _ in robot.joint]
        self._settled_rad_s2: deque[list[float]] = deque(maxlen=SETTLED_REFRESHES)
        self._unseen: Collection[int] = ()
        self._cycle = 0
        self._support = Support(cell, self.standing_rad_s, [limit.moved for limit in limits], timing.calm)
        refresh_s = timing.refresh * timing.period_s
        self._supply = Supply(self._nominals)
        steps_rad = [refresh_s * each.fastest_rad_s for each in self._nominals]
        self._stops = Stops(cell, [limit.moved for limit in limits], steps_rad)
        self._last_nm: Sequence[float] = (0.0,) * len(self.joints)
        self._flowing_nm: Sequence[float] = self._last_nm
        """Torques of the currents that flowed at the last SYNC."""

    def start(self, position_rad: Sequence[float]) -> None:
        """The arm rests at this pose; no torque acts yet."""
        for joint, position in zip(self.joints, position_rad, strict=True):
            joint.start(position)
        self._support.start(position_rad)
        self._settled_rad_s2.clear()
        self._past.clear()
        self._unseen = ()
        self._pose.start()
        self._counts.start()
        if self.grips is not None:
            self.grips.start()
        self._refresh(position_rad, (0.0,) * len(self.joints))

    def step(
        self, cycle: Cycle, angle_codes: Sequence[int], speed_codes: Sequence[int], current_codes: Sequence[int]
    ) -> None:
        """Judge the measurements of one cycle, before the law sees them. `cycle.applied_nm` acts from this SYNC on."""
        last_nm = self._last_nm
        applied_nm = self._last_nm = cycle.applied_nm
        flowing_nm = last_nm if self._decays is None else self._flow(last_nm, self._decays)
        measured_rad_s = cycle.velocity_rad_s
        driven_nm = last_nm
        if self._supply.is_short(measured_rad_s):
            driven_nm = self._supply.driven_nm(last_nm, [joint.speed for joint in self.joints])
        accelerations = self._accelerate(driven_nm)
        if self._support.joints:
            accelerations = self._from_rest(accelerations, cycle, last_nm)
        if self._stops.near:
            accelerations = self._at_stops(accelerations, cycle.position_rad)
        self._counts.take(cycle.position_rad, accelerations)
        if self._pair is not None and not self._unseen:  # two joints without a loop: a fifth of the time of `step`
            first, second = self._pair
            (x1, x2), (v1, v2), (a1, a2) = cycle.position_rad, measured_rad_s, accelerations
            replaced = int(first.step(x1, v1, a1, angle_codes[0], speed_codes[0]))
            if second.step(x2, v2, a2, angle_codes[1], speed_codes[1]):
                replaced |= 2
            is_agitated = first.is_agitated or second.is_agitated
            models, biases = (first.model_rad_s, second.model_rad_s), (first.bias, second.bias)
            self._past.append((measured_rad_s, models, biases, last_nm))
        else:
            replaced, is_agitated = self._step_all(cycle, accelerations, angle_codes, speed_codes, last_nm)
        count = self._cycle = self._cycle + 1
        for index, current in self._senses:
            if ((count + index) & 1 or current.cycles) and (
                off_a := current.differs(
                    current_codes[index], applied_nm[index], flowing_nm[index], measured_rad_s[index]
                )
            ):
                joint, mobility = self.joints[index], self._own_mobility(index)
                is_seen = joint.mode not in (Mode.NO_TACHOMETER, Mode.BLIND)
                doubt, noisiness = joint.doubt_rad_s2(mobility), joint.noisiness if is_seen else math.inf
                current.judge(off_a, measured_rad_s[index], joint.model_rad_s, joint.bias, mobility, doubt, noisiness)
        if replaced:
            self._replace(cycle, replaced)
        if count >= self._refresh_at:
            self._refresh(cycle.position_rad, [joint.speed for joint in self.joints])
        if is_agitated or self._is_surprised:
            self._look_into(count, measured_rad_s, last_nm)

    def _step_all(
        self, cycle: Cycle, accelerations: Sequence[float], angle_codes: Sequence[int], speed_codes: Sequence[int],
        acted_nm: Sequence[float],
    ) -> tuple[int, bool]:  # fmt: skip
        """Bits of the joints whose measurements are rejected, and whether any joint is agitated."""
        replaced, place, is_agitated = 0, 1, False
        unseen = self._unseen
        rows = zip(cycle.position_rad, cycle.velocity_rad_s, accelerations, angle_codes, speed_codes, strict=True)
        for index, (joint, row) in enumerate(zip(self.joints, rows, strict=True)):
            if not unseen or index not in unseen:
                x, v, acceleration, x_code, v_code = row
                if joint.step(x, v, acceleration, x_code, v_code):
                    replaced |= place
                if joint.is_agitated:
                    is_agitated = True
            place <<= 1
        models, biases = [joint.model_rad_s for joint in self.joints], [joint.bias for joint in self.joints]
        self._past.append((cycle.velocity_rad_s, models, biases, acted_nm))
        return replaced, is_agitated

    def follow(self, cycle: Cycle) -> None:
        """Judge the following error of one cycle, once its reference is known."""
        self._following.step(self._cycle, cycle)
        self._counts.follow(cycle.reference_rad)

    def coast(self, cycle: Cycle) -> None:
        """A cycle without measurements: the law gets the model's prediction."""
        for joint, acceleration in zip(self.joints, self._accelerate(self._last_nm), strict=True):
            joint.coast(acceleration)
        self._act(cycle.applied_nm)
        self._cycle += 1
        self._gap()
        self._replace(cycle, -1)
        if self._cycle >= self._refresh_at:
            self._refresh(cycle.position_rad, cycle.velocity_rad_s)

    def lose(self, joints: Collection[int]) -> None:
        """Nothing is measured of these joints any more: they are not judged."""
        self._unseen = joints
        self._past.clear()

    def shift(self, excess_s: float) -> None:
        """The time since the last measurement differs from a cycle by `excess_s`."""
        for joint, acceleration in zip(self.joints, self._accelerate(self._last_nm), strict=True):
            joint.shift(excess_s, acceleration)

    def glimpse(
        self, cycle: Cycle, angle_codes: Sequence[int], speed_codes: Sequence[int], excess_s: float, is_unclear: bool
    ) -> None:
        """As `step` for measurements whose time is known badly: `excess_s` more than a cycle after the last.

        `is_unclear`: not even the excess is known.
        """
        is_gap = is_unclear or not -LONGEST_GAP_S < excess_s < LONGEST_GAP_S
        if not is_gap:
            self.shift(excess_s)
        accelerations = self._accelerate(self._last_nm)
        self._act(cycle.applied_nm)
        self._cycle += 1
        rows = zip(cycle.position_rad, cycle.velocity_rad_s, accelerations, angle_codes, speed_codes, strict=True)
        replaced = 0
        for place, (joint, row) in enumerate(zip(self.joints, rows, strict=True)):
            replaced |= joint.glimpse(*row, is_gap) << place
        self._replace(cycle, replaced)
        for _, current in self._senses:
            current.forget()
        self._gap()
        self._refresh(cycle.position_rad, [joint.speed for joint in self.joints])

    def safe_hold(self, cycle: Cycle) -> SafeHold:
        """The law that brakes and holds the arm from its present state.

        What the model lacks is followed while it is held; of robots that are never to be without torque it is what was
        learned before the failure: what has failed would be learned too, and what grips do not allow would add up.
        """
        joints = self.joints
        start_rad_s2 = [
            model + joint.bias for model, joint in zip(self._accelerate(self._last_nm), joints, strict=True)
        ]

        def bias_rad_s2(settled: Sequence[float] = tuple(self._settled_rad_s2[0])) -> list[float]:
            rows = zip(joints, settled, self._keeps, strict=True)
            return [before if keeps else joint.bias for joint, before, keeps in rows]

        return SafeHold(
            self._arm, cycle, bias_rad_s2,
            [joint.compliance_rad_nm for joint in joints], start_rad_s2, self._timing.period_s, self._load,
        )  # fmt: skip

    def _from_rest(self, accelerations: Sequence[float], cycle: Cycle, acted_nm: Sequence[float]) -> Sequence[float]:
        """The model's expectation, less what a support holds, which the model does not know."""
        for index in self._support.leave(self._cycle, acted_nm, cycle.position_rad, cycle.velocity_rad_s):
            self.joints[index].take_load()
            self._robot_of[index].surprise.calm_until = self._cycle + self._timing.calm
            if self._support.began_moving:
                self._following.recover(self._cycle)
        expected = list(accelerations)
        for index in self._support.joints:
            expected[index] = 0.0
        return expected

    def _at_stops(self, accelerations: Sequence[float], position_rad: Sequence[float]) -> Sequence[float]:
        """The model's expectation, with the end stops, which the model does not know."""
        at = self._stops.at(position_rad)
        if not at:
            return accelerations
        borne = list(accelerations)
        for robot in self._robots:
            first, end = robot.joints.start, robot.joints.stop
            own = [(index - first, side) for index, side in at if first <= index < end]
            if not own:
                continue
            borne[robot.joints] = held(borne[robot.joints], own, robot.expected.mobility)
            if any(self.joints[first + joint].strikes(position_rad[first + joint], side) for joint, side in own):
                for joint in self.joints[robot.joints]:
                    joint.shake()
        return borne

    def _look_into(self, count: int, speed_rad_s: Sequence[float], acted_nm: Sequence[float]) -> None:
        """A joint was agitated in this cycle or recently."""
        may_stop = count > self._following.forgiven_until
        for robot in self._robots:
            robot.look_into(count, speed_rad_s[robot.joints], acted_nm[robot.joints], may_stop)
        self._is_surprised = any(robot.surprise.is_open for robot in self._robots)

    def _gap(self) -> None:
        """The time between two measurements is not known well."""
        self._past.clear()
        for robot in self._robots:
            robot.surprise.cancel()
        self._is_surprised = False
        self._following.gap(self._cycle)
        self._counts.forget()

    def _act(self, applied_nm: Sequence[float]) -> None:
        """Commands that act from this SYNC on."""
        if self._decays is not None:
            self._flow(self._last_nm, self._decays)
        self._last_nm = applied_nm

    def _flow(self, last_nm: Sequence[float], decays: Sequence[float]) -> Sequence[float]:
        """Torques of the winding currents at this SYNC, after a cycle of command `last_nm`."""
        rows = zip(last_nm, self._flowing_nm, decays, strict=True)
        self._flowing_nm = [last + (flowing - last) * decay for last, flowing, decay in rows]
        return self._flowing_nm

    def _replace(self, cycle: Cycle, replaced: int) -> None:
        """Replace the measurements of the joints whose bits are set by the substitutes."""
        position_rad, velocity_rad_s = list(cycle.position_rad), list(cycle.velocity_rad_s)
        for index, joint in enumerate(self.joints):
            if replaced >> index & 1:
                position_rad[index], velocity_rad_s[index] = joint.position_rad, joint.velocity_rad_s
        cycle.position_rad, cycle.velocity_rad_s = tuple(position_rad), tuple(velocity_rad_s)

    def _accelerate_all(self, torque_nm: Sequence[float]) -> Sequence[float]:
        """Accelerations of several robots' models under the torques, rad/s²."""
        free = [each for robot in self._robots for each in robot.expected.accelerations(torque_nm[robot.joints])]
        return free if self._held is None else self._held.accelerations(free)

    def _refresh(self, position_rad: Sequence[float], speed_rad_s: Sequence[float]) -> None:
        self._refresh_at = self._cycle + self._timing.refresh
        self._settled_rad_s2.append([joint.bias for joint in self.joints])
        self._stops.look(position_rad)
        self._pose.look(self.joints, self._cycle)
        for robot in self._robots:
            speeds = speed_rad_s[robot.joints]
            robot.expected.refresh(position_rad[robot.joints], speeds)
            robot.twist(speeds, self._last_nm[robot.joints])
        if self._held is not None:
            self._held.refresh(position_rad, speed_rad_s, [robot.expected.matrix() for robot in self._robots])
        self._counts.look([robot.expected for robot in self._robots], self._held)

    def _own_mobility(self, index: int) -> float:
        robot = self._robot_of[index]
        own: int = index - robot.joints.start
        return robot.expected.mobility[own][own]

    def _may_saturate(self, index: int) -> bool:
        """Whether an amplifier at its limit is an excuse: not if sensors or current are suspect too."""
        current = self.currents[index]
        return self.joints[index].mode is Mode.SOUND and not (current is not None and current.is_given_up)

    def _accuse_count(self, index: int, detail: str) -> None:
        joint = self.joints[index]
        if index not in self._unseen and isinstance(joint, TachlessWitness):
            joint.accuse_standing(detail)

    def _struck(self, index: int) -> int | None:
        """Where the arm has been struck, if that is why a joint's speed has stepped."""
        witness = self.joints[index]
        falls = isinstance(witness, JointWitness) and witness.mode is Mode.STEP and witness.trial.has_fallen
        return None if falls else self._robot_of[index].struck(index)

    def _teller(self, index: int) -> Report:
        doubt = self._timing.doubt
        noted_at = -doubt
        position = self._nominals[index].position.title

        def tell(detector: str, detail: str, reaction: Reaction | None) -> bool:
            nonlocal noted_at
            if detector == "current-mismatch" or (detector.startswith("current") and reaction is Reaction.DEGRADED):
                noted_at = self._cycle
            elif detector == "tachometer-spike" and (current := self.currents[index]) is not None and current.cycles:
                detector, detail = "current-mismatch", f"the current differs, and the speed leaps ({detail})"
                reaction = Reaction.SUBSTITUTE
            elif detector == "sensor-noise" and detail.startswith("tachometer") and self._cycle < noted_at + doubt:
                # A drive moves the joint, and a current sense does not: even where it has been blamed.
                detector, detail = "current-mismatch", f"noted before, and now the speed swings ({detail})"
            elif detector in OF_A_STEP and (joint := self._struck(index)) is not None:
                detail = f"a blow, or a failure of the arm (the speed steps: {detail})"
                is_believed = detector == "tachometer-jump"
                reaction = Reaction.DEGRADED if is_believed else Reaction.SUBSTITUTE
                return self._report("acceleration-mismatch", joint, detail, reaction) and not is_believed
            return self._report(named_for(position, detector), index, named_for(position, detail), reaction)

        return tell
