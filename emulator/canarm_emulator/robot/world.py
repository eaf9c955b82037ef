"""The physical world of a cell: drives, arms and sensors under one clock.

Owns virtual time and the order of events within a step. Knows voltages and latch bits; codes, registers and CAN belong
to the cards.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.model import Cell, Command, Quantity
from canarm_protocol.cell.sensing import joint_sensors

from ..errors import EmulatorError
from ..signals import Distortion
from .brakes import BrakeModel, make_brake
from .carried import ObjectState
from .drives import DriveModel, decay_over, make_drive
from .parking import Parking
from .plant import Plant
from .scan_schedule import ScanSchedule
from .sensors import Moment, Source, normal_deviates, source
from .stiffness import SHORTEST_STEP_S, STEP_SHARE
from .truth import Truth

__all__ = ["DirectionBits", "JointState", "Quantity", "SaturatedSteps", "Source", "World"]

_new = tuple.__new__  # takes a third of the time of a named tuple's own
_CURRENT, _DIRECTION = Command.CURRENT, Command.DIRECTION  # looking them up is slow
_LARGEST_SPEED_RAD_S = 1e3  # no arm gets there: the integration has diverged


class JointState(NamedTuple):
    """True state of one joint. Motor values are seen at the joint; they differ from it when the wire is elastic."""

    angle_rad: float
    speed_rad_s: float
    current_a: float
    command_a: float
    motor_angle_rad: float
    motor_speed_rad_s: float


class SaturatedSteps(NamedTuple):
    """Steps of integration in which a drive's own limit, or its supply, bounded a joint's current."""

    own: int
    supply: int


@dataclass(frozen=True, slots=True)
class _Grid:
    """A span of time cut into equal steps.

    `drives` has each joint's drive, its motor's coordinate, and the decay and the mean weight of its current in a step.
    """

    step_count: int
    step_s: float
    drives: tuple[tuple[DriveModel, int, float, float], ...]


def _samples(schedule: ScanSchedule, step_count: int) -> list[list[tuple[int, float]]]:
    """For every step of a scan, its samples: the number of each, and its time within the step, from 0 to 1.

    A sample is offset·step_count/duration steps after the start of the scan; integers keep it in the right step.
    """
    steps: list[list[tuple[int, float]]] = [[] for _ in range(step_count)]
    duration_ns = schedule.duration_ns
    for sample, offset_ns in enumerate(schedule.offsets_ns):
        step = offset_ns * step_count // duration_ns
        steps[step].append((sample, offset_ns * step_count / duration_ns - step))
    return steps


class World:
    """One cell's physics. Starts at `time_ns` = 0, every arm parked: on a support until its first bridge is on."""

    def __init__(self, cell: Cell, truth: Truth, seed: int) -> None:
        self.time_ns = 0
        self._cell, self._truth, self._seed = cell, truth, seed
        self._max_step_ns = cell.physics.max_step_us * 1000
        self._grid = functools.lru_cache(maxsize=256)(self._cut)
        self._schedule: ScanSchedule | None = None
        """Schedule of the last scan, nearly always the next one's too."""
        self._schedule_samples: list[list[tuple[int, float]]] = []
        self._held: list[int] = []
        """Indices into the plant's angles and speeds of the joints and motors on supports."""
        self.power_on()

    def power_on(self) -> None:
        """Everything but the time as at the beginning: parked, at rest, without current, the noise from its start."""
        cell, truth = self._cell, self._truth
        self._plant = Plant(cell, truth)
        self._drives = [make_drive(joint, true) for joint, true in zip(cell.joints, truth.joints, strict=True)]
        brakes = [make_brake(joint, true) for joint, true in zip(cell.joints, truth.joints, strict=True)]
        self._brakes: tuple[tuple[int, BrakeModel], ...] = tuple(
            (joint, brake) for joint, brake in enumerate(brakes) if brake is not None
        )
        self._parking = Parking(cell)
        self._connect()
        self._deviates = normal_deviates(self._seed)
        self._grid.cache_clear()
        self._schedule = None

    def _connect(self) -> None:
        """Take over what a new plant has: which coordinate is which joint's motor, and what rests on supports."""
        motors = self._plant.motor_dof
        self._moment = Moment(self._drives, motors)
        self._by_joint = list(zip(range(len(motors)), self._drives, motors, strict=True))
        """Joint, its drive, and its motor's coordinate."""
        self._hold()

    def set_dac_output(self, joint_index: int, fraction: float) -> None:
        """Output of the joint's DAC0808, I_out/I_ref from 0 to 255/256; it acts from `time_ns` on."""
        self._drives[joint_index].take(_CURRENT, fraction)

    def set_direction(self, joint_index: int, bits: int) -> None:
        """Latch bits of the joint's bridge, see `DirectionBits`. 0b11 opens the bridge and is counted.

        Raises `ValueError` outside 0..3.
        """
        self._drives[joint_index].take(_DIRECTION, bits)

    def set_grip(self, joint_index: int, bits: int) -> None:
        """Latch bits of the hand at the end of the joint's robot, see `HandBits`."""
        self._plant.move_hand(self._cell.hands[joint_index], bits)

    def set_supply(self, joint_index: int, is_on: bool) -> None:
        """Close or open the supply of the joint's amplifier, as the emergency stop does."""
        self._drives[joint_index].set_supply(is_on)

    def distort_drive(self, joint_index: int, stage: str, distortion: Distortion | None) -> None:
        """Distort the signal at a stage of the joint's drive, or no longer (None), from the next refresh on."""
        self._drives[joint_index].distort(stage, distortion)

    def refresh_command(self, joint_index: int) -> None:
        """Let the joint's amplifier follow its input again."""
        self._drives[joint_index].refresh_command()

    @property
    def truth(self) -> Truth:
        """The truth as it is now."""
        return self._truth

    def change(self, truth: Truth) -> None:
        """The true robot changes while it moves: a payload is taken up or dropped, friction rises, a winding burns.

        Sensors and converters keep their first truth. `Plant.changed` says how the motion continues.
        """
        self._plant = self._plant.changed(truth)
        self._truth = truth
        self._connect()
        for drive, joint_truth in zip(self._drives, truth.joints, strict=True):
            drive.change(joint_truth)
        for joint, brake in self._brakes:
            brake.change(truth.joints[joint])
        self._grid.cache_clear()
        self._schedule = None

    def strike(self, joint_index: int, impulse_nm_s: float) -> None:
        """Hit the joint's link, counter-clockwise if positive. An arm on its support stays there."""
        if self._held and (self._rests() or joint_index in self._held):
            return
        impulses_nm_s = [0.0] * len(self._drives)
        impulses_nm_s[joint_index] = impulse_nm_s
        self._plant.strike(impulses_nm_s)

    @property
    def saturated_steps(self) -> list[SaturatedSteps]:
        """For each joint, the steps in which its drive's own limit and its supply bounded the current."""
        return [SaturatedSteps(drive.own_limited_steps, drive.supply_limited_steps) for drive in self._drives]

    @property
    def supply_limited_steps(self) -> list[int]:
        """For each joint, the steps in which its supply bounded the current."""
        return [drive.supply_limited_steps for drive in self._drives]

    @property
    def illegal_directions(self) -> list[int]:
        """For each joint, how often its latch asked for 0b11."""
        return [drive.refused_commands for drive in self._drives]

    @property
    def brakes_engaged(self) -> list[bool | None]:
        """For each joint, whether its brake is to act now; None where it has none."""
        engaged = {joint: brake.is_engaged for joint, brake in self._brakes}
        return [engaged.get(joint) for joint in range(len(self._drives))]

    def source(self, joint_index: int, quantity: Quantity) -> Source:
        """The sensor that measures `quantity` at a joint, for `scan`. Raises `EmulatorError` if none does."""
        wired = joint_sensors(self._cell)[joint_index].measuring(quantity)
        if wired is None:
            raise EmulatorError(f"{self._cell.joint_names[joint_index]}: no sensor measures {quantity}")
        return source(wired, self._truth.joints[joint_index])

    def state(self) -> list[JointState]:
        """True state of every joint now."""
        angle, speed = self._plant.angle, self._plant.speed
        states = [
            _new(JointState, (angle[i], speed[i], drive.current_a, drive.command_a, angle[motor], speed[motor]))
            for i, drive, motor in self._by_joint
        ]
        for joint, brake in self._brakes:
            if brake.current_a:
                states[joint] = states[joint]._replace(current_a=states[joint].current_a + brake.current_a)
        return states

    @property
    def object(self) -> ObjectState | None:
        """The object that two robots carry; None if the cell has none."""
        return self._plant.object

    def object_summary(self) -> Mapping[str, Any] | None:
        """Figures of its grips since power-on: forces in N, and who has lost it; None if there is none."""
        return self._plant.object_summary()

    def open_grip(self, hand: str) -> None:
        """The "master" or the "slave" lets go of the object."""
        self._plant.open_grip(hand)

    def advance(self, until_ns: int) -> None:
        """Let time pass until `until_ns`, in equal steps of at most `physics.max_step_us`, or shorter ones if the true
        robot needs them.

        Raises `ValueError` if that time has passed, `EmulatorError` if the integration diverges.
        """
        duration_ns = until_ns - self.time_ns
        if duration_ns <= 0:
            if duration_ns < 0:
                raise ValueError(f"cannot advance to {until_ns} ns: it is {self.time_ns} ns already")
            return
        if not (self._held and self._rests()):
            grid = self._grid(duration_ns)
            for _ in range(grid.step_count):
                self._step(grid)
        else:
            self._plant.wait(duration_ns * 1e-9)
        self.time_ns = until_ns

    def scan(self, schedule: ScanSchedule) -> list[float]:
        """Sample each source at its own time after `time_ns`, and let time pass until the end of the scan.

        Returns one value per source, 0 to its `highest`. Raises `EmulatorError` if the integration diverges.
        """
        sources, duration_ns = schedule.sources, schedule.duration_ns
        values: list[float] = []
        if not duration_ns:
            moment, deviate = self._now(), self._deviates.__next__
            return [source.read(moment, 1.0, deviate()) for source in sources]
        plant, drives, moment, deviate = self._plant, self._drives, self._moment, self._deviates.__next__
        grid = self._grid(duration_ns)
        if schedule is not self._schedule:
            self._schedule, self._schedule_samples = schedule, _samples(schedule, grid.step_count)
        rests = bool(self._held) and self._rests()
        moment.step_s = grid.step_s
        for samples in self._schedule_samples:
            moment.old_angle, moment.old_speed = plant.angle, plant.speed
            moment.old_current = [drive.current_a for drive in drives]
            if rests:
                plant.wait(grid.step_s)
            else:
                self._step(grid)
            moment.angle, moment.speed = plant.angle, plant.speed
            for sample, within in samples:
                values.append(sources[sample].read(moment, within, deviate()))
        self.time_ns += duration_ns
        return values

    def sample(self, source: Source) -> float:
        """The present output of one sensor; no time passes."""
        return source.read(self._now(), 1.0, next(self._deviates))

    def _now(self) -> Moment:
        """The present state, as the end of a step that takes no time."""
        plant, moment = self._plant, self._moment
        moment.step_s = 0.0
        moment.angle = moment.old_angle = plant.angle
        moment.speed = moment.old_speed = plant.speed
        moment.old_current = [drive.current_a for drive in self._drives]
        return moment

    def _step(self, grid: _Grid) -> None:
        plant = self._plant
        angle, speed = plant.angle, plant.speed
        torque_nm = [drive.step(speed[motor], decay, mean_weight) for drive, motor, decay, mean_weight in grid.drives]
        for joint, brake in self._brakes:
            is_asked, motor_rad_s = self._drives[joint].command_a != 0.0, speed[plant.motor_dof[joint]]
            torque_nm[joint] = brake.step(is_asked, torque_nm[joint], motor_rad_s, grid.step_s)
            plant.brake(joint, brake.friction_nm)
        plant.step(torque_nm, grid.step_s)
        if self._held:
            plant.hold(angle, self._held)
        for value in plant.speed:
            if not -_LARGEST_SPEED_RAD_S < value < _LARGEST_SPEED_RAD_S:
                raise self._diverged()

    @property
    def parked(self) -> bool:
        """Whether all arms still rest on their supports."""
        return len(self._parking.joints) == len(self._drives)

    def _rests(self) -> bool:
        """Whether nothing can move, now that something is held. Robots with a bridge on leave their supports first."""
        if self._parking.free(self._drives):
            self._hold()
        return self.parked

    def _hold(self) -> None:
        joints, motors = self._parking.joints, self._plant.motor_dof
        self._held = [*joints, *(motors[joint] for joint in joints if motors[joint] != joint)]

    def _cut(self, duration_ns: int) -> _Grid:
        step_count = -(-duration_ns // self._longest_step_ns())
        step_s = duration_ns * 1e-9 / step_count
        drives = tuple((drive, motor, *decay_over(step_s, drive.time_constant_s)) for _, drive, motor in self._by_joint)
        return _Grid(step_count, step_s, drives)

    def _longest_step_ns(self) -> int:
        """The cell's longest step, or less if a wire oscillates or a motor brakes too fast for it."""
        plant, drives = self._plant, self._drives
        rates = [drive.damping_nm_s * ease for drive, ease in zip(drives, plant.compliance, strict=True)]
        rates += [brake.damping_nm_s * plant.compliance[joint] for joint, brake in self._brakes]
        fastest = max(plant.fastest_rad_s, *rates)
        shortest_ns = round(SHORTEST_STEP_S * 1e9)
        bound_ns = round(STEP_SHARE / fastest * 1e9) if fastest > 0.0 else self._max_step_ns
        return min(self._max_step_ns, max(bound_ns, shortest_ns))

    def _diverged(self) -> EmulatorError:
        return EmulatorError(
            f"cell {self._cell.name!r}: the integration diverged after {self.time_ns} ns; "
            f"physics.max_step_us = {self._cell.physics.max_step_us} must be shorter for this truth"
        )
