"""When faults act: configurations of sets, their triggers, durations and repetitions, evaluated once per cycle.

Every accepted text is a configuration of its own, and configurations run in parallel. Within one, sets follow each
other unless it is `parallel`: a set waits for its trigger until the one before has ended, or ends the one before if
that has no duration. A text is accepted as a whole or not at all.
"""

import contextlib
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from random import Random
from typing import TYPE_CHECKING, Any

from canarm_protocol.clock import Clock
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.conditions import Condition
from canarm_protocol.faults.fault_events import FaultEvent
from canarm_protocol.faults.script import FaultScript, FaultSet, Trigger
from canarm_protocol.shown import quoted

from ..robot.world import JointState
from .bench_points import BusPoint, ClockPoint, GripPoint, NodePoint
from .catalogue import PlannedFault
from .declaration import Context, Fault, JointFault, Tap, TapKind
from .guard import failure_text, guard
from .messages import MessagePoint
from .points import Point, TruthPoint, signal_point
from .taps import taps_of
from .turns import Configuration, SetState, SetStatus, Turn, Values

if TYPE_CHECKING:
    from ..bench.bench import Bench

NAME_OF_ALL = ""
"""`clear` with this name clears every set."""
MOST_AT_WORK, MOST_DONE = 2000, 100
"""Most sets that may wait or act at one time, and most finished texts that `status` still shows."""
_JOINT_KINDS = JointFault.able_at


class FaultEngine:
    """The faults of one bench. `update` is called once per cycle, and when time passes without cycles.

    `on_event` is called at every beginning and end; `seed` is for the faults' own randomness only.
    """

    def __init__(self, bench: "Bench", seed: int) -> None:
        self.taps = taps_of(bench.cell)
        self.on_event: Callable[[FaultEvent], None] | None = None
        self.active = 0
        """How many faults act now."""
        self._bench, self._seed = bench, seed
        self._configurations: list[Configuration] = []
        self._points: dict[str, Point] = {}
        self._busy: dict[Point, int] = {}
        self._truth_point = TruthPoint(bench)
        self._cycle = bench.cycle
        self._failed: list[Turn] = []
        """Sets that are to end because a fault of theirs has failed."""
        self._accepted = 0
        signals = [name for joint in bench.cell.joint_names for name in _joint_signals(joint)]
        self._signals = ("time_s", "cycle", *signals)

    def accept(self, script: FaultScript) -> str:
        """Carry out a script as a whole or not at all; returns what was done in a few words.

        Raises `FaultError` with the reason for what is not supported, and for unknown sets.
        """
        if script.clear is not None:
            return self.clear(script.clear)
        if script.trigger is not None:
            return self._pull(script.trigger)
        at_work = {turn.declared.name for turn in self._turns() if turn.state is not SetState.ENDED}
        if len(at_work) + len(script.sets) > MOST_AT_WORK:
            raise FaultError(f"{len(at_work)} sets are there already; must be at most {MOST_AT_WORK}: clear some")
        turns = []
        for position, each in enumerate(script.sets):
            if each.name == f"set {position + 1}" and each.name in at_work:
                each = replace(each, name=f"set {self._accepted + position + 1}")
            if each.name in at_work:
                raise FaultError(f"a set named {quoted(each.name)} is there already: clear it, or choose another name")
            planned = tuple(self._planned(each))
            when = each.trigger.when
            turns.append(Turn(each, None if when is None else Condition(when, self._signals), planned))
        if not script.is_parallel:
            _check_order(script.sets)
        names = {turn.declared.name for turn in turns}
        for configuration in self._configurations:
            configuration.keep([turn for turn in configuration.turns if turn.declared.name not in names])
        done = [each for each in self._configurations if each.is_done]
        forgotten = done[: max(0, len(done) - MOST_DONE)]
        self._configurations = [each for each in self._configurations if each not in forgotten and each.turns]
        self._configurations.append(Configuration(turns, script.is_parallel))
        self._accepted += len(turns)
        return "; ".join([f"accepted {', '.join(repr(turn.declared.name) for turn in turns)}", *self._remarks(script)])

    def _planned(self, declared: FaultSet) -> Iterator[PlannedFault]:
        """The faults of a set. Raises `FaultError` for one that is unknown, or that this bench does not support."""
        for number, spec in enumerate(declared.faults, start=1):
            try:
                planned = PlannedFault(self.taps, spec)
                self._check_supported(planned, spec.fault)
            except FaultError as error:
                raise FaultError(f"set {quoted(declared.name)}, fault {number}: {error}") from None
            yield planned

    def _check_supported(self, planned: PlannedFault, name: str) -> None:
        tap = planned.tap
        if planned.needs_wire and self._bench.wire is None:
            raise FaultError(
                f"{quoted(name)} at {tap.name} needs the model of the wire; start the emulator with --wire, a Rig with "
                "wire=True"
            )
        if tap.kind is TapKind.CLOCK and self._bench.clock is Clock.WALL:
            raise FaultError(
                f"{tap.name} breaks in lockstep only; on the wall clock time cannot be changed (--clock sync)"
            )

    def overdue(self, script: FaultScript) -> list[FaultSet]:
        """Sets of `script` whose time or cycle has passed, so that they would begin at once."""
        began_ns = self._run_began_ns
        if began_ns is None:
            return []
        passed_ns = self._bench.time_ns - began_ns

        def is_over(trigger: Trigger) -> bool:
            if trigger.at_s is not None:
                return round(trigger.at_s * 1e9) < passed_ns
            return trigger.cycle is not None and trigger.cycle <= self._bench.cycle

        # In a sequence, the others wait for those before them anyway.
        sets = script.sets if script.is_parallel else script.sets[:1]
        return [each for each in sets if is_over(each.trigger)]

    @property
    def run_time_s(self) -> float | None:
        """Virtual time since cycle 0 of the run that is on; None while there is none."""
        began_ns = self._run_began_ns
        return None if began_ns is None else (self._bench.time_ns - began_ns) * 1e-9

    def clear(self, name: str = NAME_OF_ALL) -> str:
        """End and forget the sets of that name, or all. Raises `FaultError` if there is none."""
        found = 0
        names = [turn.declared.name for turn in self._turns()]
        if name and name not in names:
            raise FaultError(f"no set {quoted(name)} to clear; there {_are(names)}")
        for turn in self._turns():
            if name in (NAME_OF_ALL, turn.declared.name):
                found += turn.state is not SetState.ENDED
                self._end(turn)
        for configuration in self._configurations:
            configuration.keep([turn for turn in configuration.turns if name and turn.declared.name != name])
        self._configurations = [each for each in self._configurations if each.turns]
        for point in self._points.values():
            point.drop(name or None)
        return f"cleared {found}"

    def status(self) -> list[SetStatus]:
        """Every set that was accepted and not cleared, in order."""
        return [SetStatus(turn.declared.name, turn.state, turn.activations) for turn in self._turns()]

    def plain_sets(self) -> list[dict[str, Any]]:
        """The same for JSON, with what is declared of their times."""
        return [turn.as_plain() for turn in self._turns()]

    @property
    def never_begun(self) -> list[str]:
        """Sets with faults that were accepted, not cleared, and have never been active."""
        return [turn.declared.name for turn in self._turns() if turn.declared.faults and not turn.activations]

    def update(self, now_ns: int, cycle: int) -> None:
        """Begin and end what is due. `cycle` is the number of the cycle that begins now, -1 before the first."""
        self._cycle = cycle
        if self._failed:
            self._end_failed()
        values: dict[str, float] = {}

        def signals() -> Mapping[str, float]:
            if not values:
                values.update(self._values(now_ns))
            return values

        for configuration in self._configurations:
            for turn in configuration.turns:
                if turn.state is SetState.ACTIVE:
                    if turn.is_over(now_ns):
                        self._end(turn)
                    elif turn.condition is not None:
                        turn.was_true = turn.condition.holds(signals())
            if configuration.is_parallel:
                for turn in configuration.turns:
                    if turn.state is SetState.WAITING and self._may_begin(turn, now_ns, signals):
                        self._begin(turn, now_ns)
            else:
                self._take_turns(configuration, now_ns, signals)
        for point in self._busy:
            try:
                point.refresh(now_ns)
            except Exception as error:
                self._fail_at(point, error)
        if self._failed:
            self._end_failed()

    @property
    def truth_point(self) -> TruthPoint:
        """Where faults change the truth of the arm."""
        return self._truth_point

    def _take_turns(self, configuration: Configuration, now_ns: int, values: Values) -> None:
        turns = configuration.turns
        while configuration.next_turn < len(turns):
            turn = turns[configuration.next_turn]
            if turn.state is SetState.ENDED:
                configuration.next_turn += 1
            elif turn.state is SetState.WAITING:
                if not self._may_begin(turn, now_ns, values):
                    return
                self._begin(turn, now_ns)
            else:
                following = turns[configuration.next_turn + 1 : configuration.next_turn + 2]
                lasts = turn.declared.duration_s is None
                if not (lasts and following and self._may_begin(following[0], now_ns, values)):
                    return
                self._end(turn)

    @property
    def _run_began_ns(self) -> int | None:
        """Cycle 0 of the run that is on; between runs no time counts."""
        return self._bench.begin_ns if self._bench.is_operational else None

    def _may_begin(self, turn: Turn, now_ns: int, values: Values) -> bool:
        return turn.may_begin(now_ns, self._run_began_ns, self._cycle, values)

    def _begin(self, turn: Turn, now_ns: int) -> None:
        turn.state, turn.is_pulled = SetState.ACTIVE, False
        turn.activations += 1
        turn.begun_ns = now_ns
        if not turn.declared.faults:
            self._clear_others(turn)
        for number, planned in enumerate(turn.planned):
            fault, tap = planned.fresh(), planned.tap
            guard(fault, functools.partial(self._fail, turn, fault))
            random = Random(f"{self._seed}/{turn.declared.name}/{number}/{turn.activations}")
            point = self._point(tap)
            self._busy[point] = self._busy.get(point, 0) + 1
            self.active += 1
            turn.faults.append((tap, fault))
            self._tell(now_ns, True, turn, tap, fault)
            try:
                point.add(fault, Context(tap, now_ns, self._bench.cell.bus.cycle_ns, random, turn.declared.name))
            except Exception as error:  # such as a truth that cannot be
                self._fail(turn, fault, error)

    def _fail(self, turn: Turn, fault: Fault, error: Exception) -> None:
        if turn.failure is None:
            turn.failure = fault, failure_text(fault, error)
            self._failed.append(turn)

    def _fail_at(self, point: Point, error: Exception) -> None:
        """End all faults at a point: any of them may be the cause."""
        for turn in self._turns():
            for tap, fault in turn.faults:
                if self._point(tap) is point:
                    self._fail(turn, fault, error)

    def _end_failed(self) -> None:
        failed, self._failed = self._failed, []
        for turn in failed:
            self._end(turn)
            turn.state = SetState.ENDED

    def _clear_others(self, empty: Turn) -> None:
        """An empty set clears."""
        for turn in self._turns():
            if turn is not empty and turn.state is SetState.ACTIVE:
                self._end(turn)
                turn.state = SetState.ENDED
        for point in self._points.values():
            point.drop()

    def _end(self, turn: Turn) -> None:
        now_ns = self._bench.time_ns
        (failing, failure), turn.failure = turn.failure or (None, ""), None
        for tap, fault in turn.faults:
            point = self._point(tap)
            self._busy[point] -= 1
            if not self._busy[point]:
                del self._busy[point]
            self.active -= 1
            with contextlib.suppress(Exception) if failing else contextlib.nullcontext():
                point.remove(fault, now_ns)
            self._tell(now_ns, False, turn, tap, fault, failure if fault is failing else "")
        turn.faults.clear()
        is_last = turn.activations >= turn.declared.repeat or turn.declared.duration_s is None
        turn.state = SetState.ENDED if is_last else SetState.WAITING

    def _pull(self, name: str) -> str:
        for turn in self._turns():
            if turn.declared.name == name:
                if turn.state is not SetState.WAITING:
                    raise FaultError(f"set {quoted(name)} is {turn.state.value}; only one that waits can be triggered")
                turn.is_pulled = True
                return f"triggered {quoted(name)}"
        raise FaultError(
            f"no set {quoted(name)} to trigger; there {_are([turn.declared.name for turn in self._turns()])}"
        )

    def _turns(self) -> list[Turn]:
        return [turn for configuration in self._configurations for turn in configuration.turns]

    def _point(self, tap: Tap) -> Point:
        if tap.kind in _JOINT_KINDS:
            return self._truth_point
        point = self._points.get(tap.name)
        if point is None:
            point = self._points[tap.name] = self._make_point(tap)
        return point

    def _make_point(self, tap: Tap) -> Point:
        if tap.kind is TapKind.MESSAGES:
            return MessagePoint(self._bench, tap)
        if tap.kind is TapKind.BUS:
            return BusPoint(self._bench)
        if tap.kind is TapKind.NODE:
            return NodePoint(self._bench, tap)
        if tap.kind is TapKind.GRIP:
            return GripPoint(self._bench, tap)
        if tap.kind is TapKind.CLOCK:
            return ClockPoint(self._bench)
        return signal_point(self._bench, tap)

    def _tell(self, now_ns: int, is_begin: bool, turn: Turn, tap: Tap, fault: Fault, failure: str = "") -> None:
        if self.on_event is not None:
            name = turn.declared.name
            self.on_event(FaultEvent(now_ns, self._cycle, is_begin, name, tap.name, fault.name, failure))

    def _remarks(self, script: FaultScript) -> list[str]:
        """Remarks about the times in an accepted script."""
        time_s = self.run_time_s
        if time_s is None:
            given = ["at"] * any(each.trigger.at_s is not None for each in script.sets)
            given += ["cycle"] * any(each.trigger.cycle is not None for each in script.sets)
            verb = "count" if len(given) > 1 else "counts"
            return [f"no run is on: {' and '.join(given)} {verb} from the next NMT start"] if given else []
        return [f"{quoted(each.name)} begins at once: {time_s:.3f} s are over" for each in self.overdue(script)]

    def _values(self, now_ns: int) -> Mapping[str, float]:
        began_ns = self._run_began_ns
        begin_ns = now_ns if began_ns is None else began_ns
        values = {"time_s": (now_ns - begin_ns) * 1e-9, "cycle": float(self._cycle)}
        for name, state in zip(self._bench.cell.joint_names, self._bench.world.state(), strict=True):
            values.update(zip(_joint_signals(name), _joint_values(state), strict=True))
        return values


def _joint_signals(joint: str) -> tuple[str, ...]:
    return tuple(f"{joint}.{leaf}" for leaf in ("angle_rad", "angle_deg", "speed_rad_s", "current_a", "command_a"))


def _check_order(sets: Sequence[FaultSet]) -> None:
    for each, following in itertools.pairwise(sets):
        if each.duration_s is None and following.trigger == Trigger():
            raise FaultError(
                f"set {quoted(each.name)} would end as soon as it begins: give it a duration, or set "
                f"{quoted(following.name)} a trigger"
            )


def _are(names: list[str]) -> str:
    return f"are {', '.join(map(repr, names))}" if names else "are none"


def _joint_values(state: JointState) -> tuple[float, ...]:
    angle_rad = state.angle_rad
    return angle_rad, math.degrees(angle_rad), state.speed_rad_s, state.current_a, state.command_a
