"""The control loop of one run: codes of a cycle in, DAC codes and direction bits out.

Owns the path from codes through reference, feed-forward and law to currents; frames, clocks and supervision never
enter.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Self

import numpy as np

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import DirectionBits, InputSlot, bridge_directions, command_codec

from ..dynamics import Arm, ClosedChain, cell_arm
from ..errors import ControllerError, LawError
from ..estimation.shared_grip import SharedGrip
from ..laws.base import ControlLaw, Cycle
from ..laws.failure import law_failure, shown
from ..laws.loading import LAWS
from ..reference.feedforward import FeedforwardKind, make_feedforward
from ..reference.grasped import Grasp
from ..reference.index_search import IndexSearch
from ..reference.memory import SAMPLES, TABLE_BITS, MemoryImage
from ..reference.moved import Later, Offset
from ..reference.trajectory import Reference, Trajectory
from .inputs import JointInputs

OFF = int(DirectionBits.OFF)
LEAD_CYCLES = 1.5
"""A command computed in cycle k acts from SYNC k+1 to SYNC k+2: on average 1.5 cycles later."""
CHUNK = 64
"""Ticks whose reference is converted to floats together, so that no cycle has to convert a whole block."""


class ControlLoop:
    """Law, feed-forward and trajectory of one run.

    `slots` gives the quantity of each of the `codes` in `measure`. Raises `ControllerError` for an impossible arm, law
    or feed-forward, and `LawError` for anything else that the law's own code raises, here and later.
    """

    def __init__(
        self,
        cell: Cell,
        slots: Sequence[InputSlot],
        law: type[ControlLaw],
        trajectory: Trajectory,
        feedforward: str | None = None,
    ) -> None:
        self.arm = cell_arm(cell.laden, cell.joint_names)
        self.period_s = cell.bus.cycle_s
        try:
            self.law = law(self.arm, cell.control, self.period_s)
            given: object = self.law.internals()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise law_failure(law, "__init__ or internals", error) from error
        if not isinstance(given, Mapping):
            raise LawError(
                f"law {law.__name__}: internals() returned {shown(given, repr, 40)}; must be a dict: for each name "
                "a number per joint"
            )
        self.internal_names = tuple(given)
        """Names of the law's internal values, fixed for the whole run."""
        for name in self.internal_names:
            if not _is_plain_name(name):
                raise LawError(
                    f"law {law.__name__}: internals() names a value {shown(name, repr, 40)}; "
                    "names must be ASCII letters, digits and underscores, such as 'bias_a'"
                )
        self.trajectory = self._planned = trajectory
        homing = None if cell.object is not None and cell.object.on_stand else cell.control.homing
        self.search = None if homing is None else IndexSearch(cell, homing)
        """The move by which the joints are homed, if they are; where an object is on a stand, hands are homed empty."""
        self.search_ticks = 0
        """Cycles that it takes."""
        self.feedforward_kind = feedforward or default_feedforward(cell, law)
        if self.feedforward_kind != "none" and not law.takes_feedforward:
            raise ControllerError(
                f"law {law.name!r} supplies the torque of the model itself; its feed-forward must be "
                f"none, not {self.feedforward_kind}"
            )
        limits_a = [joint.drive.max_current_a for joint in cell.joints]
        self.memory = MemoryImage(len(cell.joints), limits_a)
        self._feedforward = make_feedforward(
            self.feedforward_kind, self.arm, self.memory, law.feedforward_excludes_inertia, LEAD_CYCLES * self.period_s
        )
        self.cycle = Cycle(len(cell.joints))
        """The cycle that is recorded, reported and judged; the law gets a copy."""
        self._law_cycle = Cycle(len(cell.joints))
        chain = ClosedChain.of(cell)
        self._shared = _shared_grip(cell, self.arm, chain)
        self._grasp = None if chain is None else Grasp(chain)
        self.saturated_cycles = [0] * len(cell.joints)
        """Cycles in which the law asked for more current than the amplifier has."""
        self.stopwatch: Callable[[], int] | None = None
        """Gives monotonic ns, if the law's computing time is to be measured."""
        self.law_ns = 0
        """Computing time of the law in the last cycle, if measured."""
        self._checks_internals = law not in LAWS.values()
        self._internals: Mapping[str, Sequence[float]] | None = None
        self._limits_a = limits_a
        self._amplifiers = [
            (
                per_ampere,
                limits_a[joint],
                command_codec(cell, joint).full_scale,
                tuple(map(int, bridge_directions(cell, joint))),
            )
            for joint, per_ampere in enumerate(self.arm.torque_per_ampere)
        ]
        """Of each joint the torque in N·m per ampere, the largest current and its DAC code, and the direction bits for
        a negative and for a positive torque, as plain integers, which are faster."""
        self._unsaturated = (False,) * len(cell.joints)
        self.inputs = JointInputs(cell, slots, self.arm)
        """Scales of what is measured, and the codes of the last cycle."""
        self._block: Reference | None = None
        self._block_tick = self._chunk_tick = 0
        self._reference: list[tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]] = []
        self._signs = [0.0] * len(cell.joints)

    def begin(self, position_codes: Sequence[int]) -> None:
        """Start at rest at the measured pose: enter the trajectory from there, fill the table, start the law.

        Where the joints are homed first, `search_ticks` are for that; then `home` is due. Raises `TrajectoryError` when
        the pose lies outside the joint limits, or too far off; `LawError`.
        """
        start = self.inputs.start(position_codes)
        rest = (0.0,) * len(start)
        self.trajectory = self._planned.entered_from(start)
        if self.search is not None:
            self.trajectory, self.search_ticks = self.search.move(start, self._planned)
        self.cycle.position_rad, self.cycle.velocity_rad_s = start, rest
        self._prepare(0)
        try:
            self.law.start(start, rest, self.trajectory.amplitude_rad)
        except BaseException as error:
            raise law_failure(type(self.law), "start", error) from error

    def home(self, zeros: Sequence[float], tick: int) -> None:
        """The search has found the zeros (counts) of its marks: from `tick` on, angles are what they truly are.

        Nothing moves by that. The trajectory is entered from here. Raises `TrajectoryError` and `LawError` as `begin`.
        """
        assert self.search is not None
        joints = [mark.joint for mark in self.search.marks]
        shift = self.inputs.rezero(dict(zip(joints, zeros, strict=True)))
        try:
            self.law.shift(shift)
        except BaseException as error:
            raise law_failure(type(self.law), "shift", error) from error
        start = np.add(self.cycle.reference_rad, shift)
        planned = self._planned
        first = planned.sample(0, 1, self.period_s).position_rad[0]
        if self._grasp is not None:
            offset = self._grasp.slave_offset(shift, first)
            planned, first = Offset(planned, offset), first + offset
        entered = planned.entered_from(start.tolist(), self.search.slow_s(start, first))
        self.trajectory = Later(entered, tick * self.period_s)
        self._prepare(tick - tick % SAMPLES)

    def take_over(self, before: Self, tick: int, rest_s: float) -> None:
        """Begin in cycle `tick`, at rest, where another loop has led the same joints, and from what it measures.

        The trajectory follows after `rest_s` or more.
        Raises `TrajectoryError` and `LawError` as `begin`.
        """
        self.stopwatch, self.saturated_cycles = before.stopwatch, before.saturated_cycles
        cycle, reference = self.cycle, before.cycle.reference_rad
        cycle.copy_from(before.cycle)
        self.inputs.take_over(before.inputs)
        entered = self._planned.entered_from(reference, rest_s)
        self.trajectory = Later(entered, tick * self.period_s)
        self._prepare(tick - tick % SAMPLES)
        try:
            self.law.start(cycle.position_rad, (0.0,) * len(reference), entered.amplitude_rad)
        except BaseException as error:
            raise law_failure(type(self.law), "start", error) from error

    def measure_search(self) -> None:
        """Look, in a cycle of the search, at what its measurements say of the hands at the object."""
        if self._grasp is not None:
            self._grasp.see(self.cycle.position_rad, self.cycle.reference_rad_s)

    def measure(self, codes: Sequence[int], tick: int) -> None:
        """Take the codes of one cycle: physical values into `cycle`, codes into the memory's log."""
        inputs = self.inputs
        inputs.take(codes, self.cycle, self._signs)
        self.memory.log(tick, *inputs.log_bytes())

    def look_up(self, tick: int) -> None:
        """The reference of `tick` into `cycle`; a new block of 4096 ticks is prepared when one begins."""
        place = tick - self._chunk_tick
        if not 0 <= place < CHUNK:
            if not 0 <= tick - self._block_tick < SAMPLES:
                self._prepare(tick - tick % SAMPLES)
            self._unpack(tick - tick % CHUNK)
            place = tick % CHUNK
        cycle = self.cycle
        cycle.tick = tick
        cycle.reference_rad, cycle.reference_rad_s, cycle.reference_rad_s2 = self._reference[place]

    def torque_nm(self) -> Sequence[float]:
        """The law's torques for this cycle, N·m, not yet judged. Raises `LawError` or `InterruptedRunError`."""
        cycle, law_cycle = self.cycle, self._law_cycle
        cycle.feedforward_nm = tuple(self._feedforward.torque_nm(cycle.tick))
        law_cycle.copy_from(cycle)
        if self._shared is not None:
            self._shared.show(law_cycle)
        stopwatch = self.stopwatch
        begun_ns = 0 if stopwatch is None else stopwatch()
        self._internals = None
        try:
            try:
                torque_nm = self.law.update(law_cycle)
            except BaseException as error:
                raise law_failure(type(self.law), "update", error) from error
            if self._checks_internals:
                self.internals()
        finally:
            if stopwatch is not None:
                self.law_ns = stopwatch() - begun_ns
        return torque_nm

    def eased(self, torque_nm: Sequence[float]) -> list[float]:
        """The law's torques (N·m) without what would press two hands against each other at an object."""
        plain = list(map(float, torque_nm))
        if self._shared is None or not self.law.takes_feedforward:
            return plain
        return self._shared.eased(plain, self.cycle.feedforward_nm)

    def outputs(self, torque_nm: Sequence[float]) -> tuple[list[int], list[int]]:
        """DAC codes and direction bits of the torques, limited to what the amplifiers have."""
        codes, directions, applied = [], [], []
        signs, saturated = self._signs, self._unsaturated
        for joint, torque in enumerate(torque_nm):
            per_ampere, limit, full_code, ways = self._amplifiers[joint]
            current = torque / per_ampere
            if not -limit <= current <= limit:
                current = limit if current > 0.0 else -limit
                self.saturated_cycles[joint] += 1
                saturated = (*saturated[:joint], True, *saturated[joint + 1 :])
            if current < 0.0:
                signs[joint], magnitude, way = -1.0, -current, ways[0]
            else:
                signs[joint], magnitude, way = 1.0, current, ways[1]
            code = int(magnitude * full_code / limit + 0.5)
            codes.append(code)
            directions.append(way if code else OFF)
            applied.append(current * per_ampere)
        self.cycle.applied_nm, self.cycle.saturated = tuple(applied), saturated
        return codes, directions

    def internals(self) -> Mapping[str, Sequence[float]]:
        """The law's named internal values. Raises `LawError` unless there is one number per joint for every name.

        A law is asked once per cycle, recorded or not, so that a run ends in the same way everywhere.
        """
        if self._internals is not None:
            return self._internals
        try:
            given = self.law.internals()
        except BaseException as error:
            raise law_failure(type(self.law), "internals", error) from error
        if not self._checks_internals:  # one of canarm's own laws
            self._internals = given
            return given
        try:
            values = {name: [float(value) for value in row] for name, row in given.items()}
        except (AttributeError, TypeError, ValueError):  # a number for all joints, a text, no dict
            values = {}
        if tuple(values) != self.internal_names or any(len(row) != len(self._limits_a) for row in values.values()):
            raise LawError(
                f"law {type(self.law).__name__}: internals() must give {len(self._limits_a)} numbers, one per joint, "
                f"for each of the names that it gave at first ({', '.join(self.internal_names) or 'none'})"
            )
        self._internals = values
        return values

    def _prepare(self, first_tick: int) -> None:
        self._block = self.trajectory.sample(first_tick, SAMPLES, self.period_s)
        self._block_tick = first_tick
        self._feedforward.prepare(self._block, first_tick)
        self._unpack(first_tick)

    def _unpack(self, tick: int) -> None:
        block, sample = self._block, tick - self._block_tick
        assert block is not None
        parts = (block.position_rad, block.velocity_rad_s, block.acceleration_rad_s2)
        rows = (map(tuple, part[sample : sample + CHUNK].tolist()) for part in parts)
        self._reference = list(zip(*rows, strict=True))
        self._chunk_tick = tick


def _shared_grip(cell: Cell, arm: Arm, chain: ClosedChain | None) -> SharedGrip | None:
    if chain is None or cell.object is None:
        return None
    return SharedGrip(chain, arm.effective_inertia, cell.object.grip_stiffness)


def default_feedforward(cell: Cell, law: type[ControlLaw]) -> str:
    """The default source of the feed-forward of `law`.

    A byte of the table is as fine as an 8-bit DAC; with a finer DAC the torque is computed on line instead.
    """
    bits = max(command_codec(cell, joint).bits for joint in range(len(cell.joints)))
    kind = FeedforwardKind(law.default_feedforward)
    return FeedforwardKind.ONLINE if kind is FeedforwardKind.TABLE and bits > TABLE_BITS else kind


def _is_plain_name(name: object) -> bool:
    """Whether it can head a column of a CSV file and name an object on the bench."""
    return isinstance(name, str) and name.isascii() and name.isidentifier()
