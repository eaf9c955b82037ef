"""The controller under test, without any input or output: frames and times go in, frames come out.

Owns the states of a run, from finding the cards to leaving them safe. Sockets, pacing and files belong to the runner.
The same object runs in a process of its own or inside a test.
"""

import math
from collections.abc import Callable, Sequence

from canarm_protocol.canopen.frames import Cob, Frame
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import CardNode, InputSlot
from canarm_protocol.clock import Clock

from ..bus.master import start_frames, stop_frames
from ..errors import BringUpError, ControllerError, InterruptedRunError
from ..supervision.arrivals import OWED_NS, Arrivals
from ..supervision.detection import DETECTORS
from ..supervision.supervisor import Supervisor, Verdict
from .awaited_inputs import AwaitedInputs
from .beginning import Beginning
from .carrying import CarryingRefresh
from .loop import ControlLoop
from .preparation import Preparation
from .state import State

ENDED = State.DONE, State.FAILED
_RUNNING, _STOPPING, _BRINGING_UP = State.RUNNING, State.STOPPING, State.BRINGING_UP  # looking them up is slow
_TIME = int(Cob.TIME)
MISSING_NOTED = DETECTORS["inputs-missing"].debounce_cycles


class Controller(Beginning):
    """One run. Its driver hands in every frame, sends the frames in `outbox`, and calls `open_cycle` on time.

    On the wall clock the runner opens a cycle every period. In lockstep `receive` does so itself when TIME has come.
    `on_tick` is called at the end of every controlled cycle; a `ControllerError` (from the law's internals) or an
    `OSError` (from a recording) that it raises stops the robot.
    """

    def __init__(
        self,
        cell: Cell,
        nodes: tuple[CardNode, ...],
        slots: tuple[InputSlot, ...],
        loop: ControlLoop,
        clock: Clock,
        ticks: int | None = None,
        listen_ns: int = 0,
    ) -> None:
        super().__init__(cell, nodes, slots, loop, clock, ticks)
        self.clock = clock
        self._is_lockstep = clock is Clock.SYNC
        self.outbox: list[Frame] = []
        self.controlled_ticks = 0
        self.missed = 0
        """Cycles of the run, up to its stop, whose inputs were not complete in time."""
        self.ignored_frames = 0
        """Malformed process data, and frames that CANopen does not know: 29-bit identifiers, remote requests."""
        self.error: ControllerError | None = None
        self.cycle_is_open = False
        """Whether inputs of the cycle are still to come."""
        self.on_tick: Callable[[], None] | None = None
        self.begun_ns: int | None = None
        """On the wall clock: when cycle 0 was opened, once it has been."""
        self._opened_ns = 0
        self._supervisor = Supervisor(cell, nodes)
        self._times = self._measuring.times
        search = self.loop.search
        marks = () if search is None else search.marks
        self._preparation = Preparation(cell, nodes, clock, listen_ns, self._begin_loop, marks)
        self._carrying = CarryingRefresh(cell, nodes, self._weight_nm) if cell.carry_refresh_cycles else None
        self._inputs = AwaitedInputs(nodes, slots)
        owed_cycles = 1 if self._is_lockstep else max(OWED_NS // cell.bus.cycle_ns, 1)
        self._arrivals = Arrivals(self._inputs.layouts, self._detect_at_node, owed_cycles)

    @property
    def is_finished(self) -> bool:
        """Whether the run is over, well or badly."""
        return self.state in ENDED

    @property
    def planned_ticks(self) -> int | None:
        """How many ticks the run is to last; None if it goes on until it is stopped."""
        return self._ticks

    @property
    def run_ns(self) -> int:
        """Time of the present cycle's SYNC since that of cycle 0; 0 before."""
        if self.begun_ns is not None:
            return self._opened_ns - self.begun_ns
        return max(self.tick, 0) * self.cell.bus.cycle_ns if self._is_lockstep else 0

    @property
    def deadline_ns(self) -> int | None:
        """When to call `time_out`, in the time that is handed in; None while no answer is awaited."""
        return self._preparation.deadline_ns

    @property
    def reason(self) -> str | None:
        """Why the run failed or was stopped; None if it went as planned."""
        cause = self.error or self.verdict
        return None if cause is None else str(cause)

    def begin(self, now_ns: int) -> None:
        """Start finding the cards."""
        self.state = State.BRINGING_UP
        self._converse(None, now_ns)

    def receive(self, frame: Frame, now_ns: int) -> None:
        """Take one frame from the bus. A malformed or foreign one is counted in `ignored_frames`; it stops nothing.

        In lockstep every TIME ends a cycle. A TIME that is ahead means that its SYNC was late. A TIME that cannot
        belong to this cycle begins the safe stop, which tolerates extra TIMEs.
        """
        can_id, data, is_extended, is_remote = frame
        if is_extended or is_remote:
            self.ignored_frames += 1
            return
        layout = self._inputs.layouts.get(can_id)
        if layout is not None:
            if self.state >= _RUNNING:
                self._times.arrive(now_ns)
                self._take_inputs(layout, data)
        elif can_id == _TIME:
            if self._is_lockstep and self.cycle_is_open:
                if self.state is _RUNNING:
                    self._take_time(data)
                self.close_cycle()
                self.open_cycle()
        elif self._is_answer(frame):
            pass
        elif self._preparation.is_on:
            if self._preparation.is_answer(frame):
                self._converse(frame, now_ns)
        elif self.state is _RUNNING or self.verdict is not None:
            self._judge(self._supervisor.message(frame, self.tick))

    def _is_answer(self, frame: Frame) -> bool:
        """Take a frame that answers what was asked while the loop runs."""
        homing, carrying = self._homing, self._carrying
        return (homing is not None and homing.take(frame)) or (carrying is not None and carrying.take(frame))

    def _take_time(self, data: bytes) -> None:
        """In lockstep: judge the TIME, and note the delay of the next measurement."""
        supervisor = self._supervisor
        self._judge(supervisor.time(data))
        if supervisor.late_ns:
            self._times.delay(supervisor.late_ns)
            if self.state is _RUNNING:
                self._detect("deadline-missed", None, f"SYNC was {supervisor.late_ns / 1e6:g} ms late")

    def _take_inputs(self, layout: PdoLayout, data: bytes) -> None:
        inputs = self._inputs
        if not inputs.take(layout, data):
            self.ignored_frames += 1
            return
        awaited, cob_id = inputs.awaited, layout.cob_id
        if cob_id in awaited:
            awaited.discard(cob_id)
        elif self.state is _RUNNING:
            self._arrivals.extra(cob_id)
        if not self._is_lockstep and not awaited and self.cycle_is_open:
            self.close_cycle()

    def time_out(self, now_ns: int) -> None:
        """`deadline_ns` has passed without the awaited answer."""
        if self.deadline_ns is not None:
            self._converse(None, now_ns, is_silent=True)

    def open_cycle(self, now_ns: int | None = None) -> None:
        """Begin a cycle: SYNC goes out, after a heartbeat when one is due.

        On the wall clock `now_ns` is the time, on the clock of `receive`: the lengths of cycles vary.
        """
        if self.cycle_is_open:
            self._miss()
            self.close_cycle()
        if self.state is _BRINGING_UP or self.state in ENDED:
            return
        tick = self.tick = self.tick + 1
        if now_ns is not None:
            if tick == 0:
                self.begun_ns = now_ns
            self._opened_ns = now_ns
        self._times.open_cycle(now_ns)
        self._arrivals.open_cycle(self._inputs.awaited if tick else ())
        if self._homing is not None:
            self.outbox += self._homing.opening(tick)
        self.outbox += self._frames.opening(tick)
        self._inputs.open_cycle()
        self.cycle_is_open = True

    def close_cycle(self) -> None:
        """End a cycle: compute the outputs that act at the next SYNC from its inputs."""
        self.cycle_is_open = False
        if self._ticks is not None and not self._is_beginning and self.controlled_ticks >= self._ticks:
            self.end()
        if self.state is _RUNNING:
            if self._is_lockstep and self._inputs.awaited:
                self._miss()
            if self.state is _RUNNING:
                self._judge(self._supervisor.begin_cycle(self.tick))
            if self.state is _RUNNING:
                self._control()
        if self.state is _STOPPING:
            self._stop_step()
        if self._carrying is not None and self._homing is None and self.state in (_RUNNING, _STOPPING):
            self.outbox += self._carrying.frames(self.tick, self.loop.cycle.position_rad, self._stop.frozen)

    def note_missed_deadlines(self, count: int) -> None:
        """The pacer has left out `count` cycles: the wall clock was ahead."""
        if self.state is _RUNNING:
            self._detect("deadline-missed", None, f"{count} cycles left out")

    def interrupt(self, detail: str) -> None:
        """Stop safely because the user says so."""
        if self.state is _RUNNING:
            self._judge(Verdict("interrupted", detail))
        elif not self.is_finished and self.state is not State.STOPPING:
            self.lose(InterruptedRunError(f"interrupted: {detail}"))

    def end(self) -> None:
        """Stop as planned, before the last tick; during bring-up the run ends when the cards have been found."""
        if self.state is _RUNNING:
            self.state = State.STOPPING
            self._stop.begin(is_hold=False)
        elif self.state is State.BRINGING_UP:
            self._ticks = 0
        elif self.state is State.IDLE:
            self.state = State.DONE

    def lose(self, error: ControllerError) -> None:
        """The bus is lost, or nobody answers any more: nothing can be sent, and the cards protect themselves."""
        if not self.is_finished:
            self.error = self.error or error
            self.state = State.FAILED
            self.outbox.clear()
            self.cycle_is_open = False
            self._preparation.end()

    def _converse(self, answer: Frame | None, now_ns: int, is_silent: bool = False) -> None:
        try:
            frames = self._preparation.go_on(answer, now_ns, is_silent)
        except ControllerError as error:
            self._keep_interruption(error)
            self.lose(error)
            if not isinstance(error, BringUpError):
                self.outbox += stop_frames(self._nodes)
            return
        if frames is not None:
            self.outbox += frames
            return
        self.state = State.RUNNING
        self.outbox += start_frames(self._nodes, self.cell.bus.controller_node_id)
        if self._is_lockstep:
            self.open_cycle()

    def _control(self) -> None:
        loop = self.loop
        if not self._inputs.awaited:
            if self._homing is not None:
                self._home(self._homing)
            self._measure()
            if self._homing is not None:
                loop.measure_search()
            elif self._grasping is not None and self.state is _RUNNING:
                self._grasp(self._grasping)
                loop = self.loop
        else:
            self._watch.coast(loop.cycle)
        if self.state is _RUNNING:
            loop.look_up(self.tick)
            self._watch.follow(loop.cycle)
        if self.state is _RUNNING:
            torque_nm = self._law_output()
            if torque_nm is not None:
                self.outbox += self._frames.outputs(*loop.outputs(torque_nm))
                self.controlled_ticks += 1
                if self.on_tick is not None:
                    self.guard(self.on_tick)

    def _measure(self) -> None:
        """Take and judge what the cards have measured."""
        sample = self._measuring.take(self._inputs.codes, self.tick)
        if self.state is _RUNNING:
            left_out = math.inf if self._is_rezeroed else sample.left_out_s / self.loop.period_s
            self._judge(self._supervisor.measurement(self.loop.cycle.position_rad, left_out))
        if self._is_rezeroed:
            self._is_rezeroed = False
            self._watch.start(self.loop.cycle.position_rad)
        else:
            self._measuring.judge(sample)
        grips = self._watch.grips
        if grips is not None and self.state is _RUNNING:
            self._judge(grips.step(self.loop.cycle.position_rad))

    def _law_output(self) -> Sequence[float] | None:
        """The law's torques; None if they are unusable."""
        try:
            torque_nm = self.loop.torque_nm()
        except ControllerError as error:
            self._judge_law(error)
            return None
        verdict = self._supervisor.command(torque_nm)
        if verdict is None:
            eased = self.loop.eased(torque_nm)
            return eased if self._grasping is None else self._grasping.relieved(eased, self.tick)
        self._judge(verdict)
        return None

    def _miss(self) -> None:
        if self.state is _RUNNING:
            self.missed += 1
            waiting_for = self._inputs.describe_awaited()
            self._times.missing_cycles += 1
            if self._times.missing_cycles == MISSING_NOTED:
                self._detect("inputs-missing", None, f"no {waiting_for} for {MISSING_NOTED} cycles")
            is_timed, is_part_silent = not self._is_lockstep, self._inputs.is_part_silent
            self._judge(self._supervisor.missing(waiting_for, is_timed=is_timed, is_part_silent=is_part_silent))

    def _stop_step(self) -> None:
        """Torque off, or the arm held; cycles go on until it stands still, so that it is watched."""
        unseen = self._inputs.unseen_joints()
        has_inputs = not self._inputs.awaited if not self._stop.keeps_any else len(unseen) < len(self.cell.joints)
        is_planned = self.verdict is None
        if self._stop.begin_cycle(is_planned) and has_inputs:
            if self._stop.holds:
                self._stop.doubt(unseen, is_drive=False)
                self._watch.lose(self._stop.frozen | unseen)
                self._measure()
            else:
                self.loop.measure(self._inputs.codes, self.tick)
        step = self._stop.step(is_planned, has_inputs)
        if step.is_over:
            self.outbox += stop_frames(self._nodes)
            self.state = State.DONE if is_planned else State.FAILED
        else:
            torque_nm, frames = step.torque_nm, self._frames
            self.outbox += frames.no_torque if torque_nm is None else frames.outputs(*self.loop.outputs(torque_nm))
