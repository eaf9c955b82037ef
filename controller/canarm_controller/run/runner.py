"""Drives a controller over real buses: the edge that owns ports, wall clock and pacing."""

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.sdo import SdoAborted
from canarm_protocol.cell.bench_objects import CONTROLLER_CHANNEL, sdo_channel
from canarm_protocol.clock import Clock
from canarm_protocol.errors import BusError, ProtocolError
from canarm_protocol.transport.port import BusPort
from canarm_protocol.transport.realtime import Collector, undisturbed
from canarm_protocol.transport.sdo_session import SdoSession

from ..bus.assessment import JointFigures, name_law, read_assessment, tell_outcome, tell_plan
from ..errors import ControllerError
from .controller import Controller
from .pacing import LockstepPace, Pacer
from .report import BenchReport
from .starvation import Starvation, explains, long_law
from .state import State

ANSWER_S = 10.0
"""Default wait of lockstep for the emulator's TIME, whatever else arrives meanwhile."""
POLL_S = 0.1
"""Longest wait before asking whether the user wants to stop."""
LISTEN_NS = 250_000_000
"""How long a controller listens for another one before it takes the bus: several of its heartbeats."""


@dataclass(slots=True)
class RunResult:
    """How a run went."""

    state: State
    reason: str | None
    ticks: int
    missed: int
    late: int
    real_time_factor: float
    pacing: Pacer | None
    joints: dict[str, JointFigures] = field(default_factory=dict)
    note: str | None = None
    """Why something is missing in `joints`, if it is."""
    starved: str | None = None
    """Why many cycles were left out, if they were."""


class Runner:
    """One run of `controller` over `port`, with its reports on `bench` if there is one.

    `on_state` is called with every change of state; `should_stop` is called once per cycle and may return a reason to
    stop safely. `clock` gives monotonic ns. On the wall clock, the last `spin_ns` before a deadline are polled instead
    of slept, which keeps a core busy for a punctual SYNC. In lockstep virtual time passes at most `pace` times as fast
    as `clock`, and `answer_s` bounds the wait for the emulator's TIME; it is infinite if a debugger may hold the
    emulator.
    """

    def __init__(
        self,
        controller: Controller,
        port: BusPort,
        bench: BusPort | None,
        on_state: Callable[[State], None] = lambda state: None,
        should_stop: Callable[[], str | None] = lambda: None,
        clock: Callable[[], int] = time.perf_counter_ns,
        spin_ns: int = 0,
        pace: float = math.inf,
        answer_s: float = ANSWER_S,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._controller, self._port, self._bench = controller, port, bench
        self._on_state, self._should_stop, self._clock = on_state, should_stop, clock
        self._spin_s = spin_ns * 1e-9
        self._report = BenchReport(controller.cell, controller, self._late_or_left_out) if bench is not None else None
        self._state = State.IDLE
        self._note: str | None = None if bench is not None else "no bench bus: the true error is not known here"
        self._pacer: Pacer | None = None
        self._pace, self._answer_s, self._sleep = pace, answer_s, sleep
        self._lockstep_pace: LockstepPace | None = None
        self._starvation = Starvation(controller.cell.bus.cycle_ns)
        self._last_cause: str | None = None
        """The lack of computing time that explained the last detection."""
        self._collector: Collector | None = None
        self._record: Callable[[], None] | None = None
        self._is_tick_untold = False
        self._inputs_ns: int | None = None
        """Arrival time of the frames that are being handed to the controller."""
        self._owns_the_bus = False
        """Whether the cards are ours; before that, another controller's report must not be disturbed."""
        self._started_ns = self._ended_ns = 0

    @property
    def missed(self) -> int:
        """Cycles missed so far: without all of their inputs in time, or left out."""
        return self._controller.missed + (self._pacer.missed if self._pacer else 0)

    def tell_outcome(self, lines: Sequence[str]) -> None:
        """After `run`: tell the bench how the run has ended, for those who watch. A bench that is lost is not told."""
        session = self._session() if self._controller.tick >= 0 else None
        if session is not None:
            with contextlib.suppress(ProtocolError):
                tell_outcome(session, lines)

    def run(self) -> RunResult:
        """From finding the cards to leaving them safe. Every wait is bounded; exceptions of a bus do not escape."""
        if self._controller.clock is Clock.SYNC:
            return self._run()
        with undisturbed(self._clock) as self._collector:
            return self._run()

    def _run(self) -> RunResult:
        controller = self._controller
        self._record, controller.on_tick = controller.on_tick, self._on_tick
        controller.loop.stopwatch, controller.starved_by = self._clock, self._starved_by
        try:
            self._bring_up()
            self._started_ns = self._clock()
            if not controller.is_finished:
                if controller.clock is Clock.SYNC:
                    self._run_lockstep()
                else:
                    self._run_on_the_wall_clock()
        except BusError as error:
            controller.lose(ControllerError(f"bus lost: {error}"))
        self._ended_ns = self._clock()
        self._watch_state()
        return self._result(self._assess())

    def _on_tick(self) -> None:
        """A cycle has been controlled. Frames are sent first; records and reports come after them.

        In lockstep these include the next SYNC, which the controller sends last, so that the emulator computes
        meanwhile.
        """
        pacer, inputs_ns = self._pacer, self._inputs_ns
        if self._controller.clock is Clock.SYNC:
            self._is_tick_untold = True
            return
        if pacer is not None and inputs_ns is not None:
            self._flush()
            law_ns = self._controller.loop.law_ns
            self._starvation.law(law_ns)
            pacer.controlled(inputs_ns, law_ns)
        self._tell_tick()
        if pacer is not None and self._collector is not None:
            self._collector.cycle_done(pacer.next_ns - self._clock())

    def _tell_tick(self) -> None:
        self._is_tick_untold = False
        if self._record is not None:
            self._record()
        if self._report is not None:
            self._report.tick()

    def _bring_up(self) -> None:
        controller = self._controller
        controller.begin(self._clock())
        while controller.state is State.BRINGING_UP:
            self._watch_state()
            self._flush()
            assert controller.deadline_ns is not None
            left_s = (controller.deadline_ns - self._clock()) * 1e-9
            if left_s <= 0.0:
                controller.time_out(self._clock())
            else:
                self._take(self._port.receive(min(left_s, POLL_S)))
            self._ask_to_stop()
        if not controller.is_finished:
            self._owns_the_bus = True
            self._name_law()
        self._watch_state()
        self._flush()

    def _run_lockstep(self) -> None:
        controller, port = self._controller, self._port
        tick, sent_ns = controller.tick, self._clock()
        if math.isfinite(self._pace):
            self._lockstep_pace = LockstepPace(controller.cell.bus.cycle_ns, self._pace, self._clock)
        while not controller.is_finished:
            self._flush()
            self._take(port.receive(POLL_S))
            if controller.tick != tick:
                tick, sent_ns = controller.tick, self._clock()
            elif (self._clock() - sent_ns) * 1e-9 > self._answer_s:
                controller.lose(
                    ControllerError(f"no TIME from the emulator within {self._answer_s:g} s of SYNC {controller.tick}")
                )
            self._publish()
            self._ask_to_stop()
        self._flush()

    def _run_on_the_wall_clock(self) -> None:
        controller, port = self._controller, self._port
        spin_s = self._spin_s
        pacer = self._pacer = Pacer(controller.cell.bus.cycle_ns, self._clock)
        while not controller.is_finished:
            left_out = pacer.missed
            pacer.begin(counts=controller.state is State.RUNNING)
            if pacer.missed > left_out:
                self._starvation.left_out(self._clock(), pacer.missed - left_out)
                controller.note_missed_deadlines(pacer.missed - left_out)
            controller.open_cycle(self._clock())
            self._flush()
            self._publish()
            self._ask_to_stop()
            left_s = pacer.left_s()
            while not controller.is_finished:  # at least once: what has arrived is read however late it is
                self._take(port.receive(max(left_s - spin_s, 0.0)))
                self._flush()
                left_s = pacer.left_s()
                if left_s <= 0.0:
                    break
        self._flush()

    def _take(self, batch: list[tuple[int, Frame]]) -> None:
        controller = self._controller
        now_ns = self._inputs_ns = self._clock()
        for _, frame in batch:
            controller.receive(frame, now_ns)
            if self._is_tick_untold:
                self._flush()
                controller.guard(self._tell_tick)
        self._inputs_ns = None
        if controller.state is not self._state:
            self._watch_state()

    def _flush(self) -> None:
        controller = self._controller
        if controller.outbox:
            if self._lockstep_pace is not None:
                self._hold_back(self._lockstep_pace)
            frames, controller.outbox = controller.outbox, []
            self._port.send(frames)

    def _hold_back(self, pace: LockstepPace) -> None:
        """Wait until the SYNC of the cycle may be sent, or the user wants to stop."""
        while (left_s := pace.left_s(self._controller.tick)) > 0.0:
            self._sleep(min(left_s, POLL_S))
            self._ask_to_stop()

    def _starved_by(self, detector: str, detail: str) -> str | None:
        controller = self._controller
        is_lockstep = controller.clock is Clock.SYNC
        if not explains(detector, detail, is_lockstep=is_lockstep):
            return None
        if is_lockstep:
            cause = long_law(controller.loop.law_ns, controller.loop.cycle.tick)
        else:
            cause = self._starvation.cause(self._clock())
        verdict, last = controller.verdict, self._last_cause
        if cause is None and last is not None and verdict is not None and verdict.detail.startswith(last):
            return last  # it has begun the safe stop, until the end of which the cards stay as they are
        self._last_cause = cause
        return cause

    def _publish(self, everything: bool = False) -> None:
        if self._report is None or self._bench is None or not self._owns_the_bus:
            return
        frames = self._report.take(everything)
        if frames:
            try:
                self._bench.send(frames)
                self._bench.receive(0.0)
            except BusError as error:
                self._note = f"bench bus lost: {error}"
                self._bench = None

    def _ask_to_stop(self) -> None:
        reason = self._should_stop()
        if reason is not None:
            self._controller.interrupt(reason)

    def _watch_state(self) -> None:
        if self._controller.state is not self._state:
            self._state = self._controller.state
            self._on_state(self._state)
            self._publish(everything=True)

    def _session(self) -> SdoSession | None:
        if self._bench is None:
            return None
        return SdoSession(self._bench, *sdo_channel(self._controller.cell.bus.bench_node_id, CONTROLLER_CHANNEL))

    def _name_law(self) -> None:
        session = self._session()
        if session is not None:
            try:
                loop = self._controller.loop
                name_law(session, str(loop.law.name), loop.internal_names)
                pace = self._pace if self._controller.clock is Clock.SYNC else None
                with contextlib.suppress(SdoAborted):  # a bench without these objects
                    tell_plan(session, self._controller.planned_ticks, pace)
            except ProtocolError as error:
                self._note = f"no bench node answers: {error}"
                self._bench = None

    def _assess(self) -> dict[str, JointFigures]:
        if self._controller.tick < 0:
            return {}
        self._publish(everything=True)
        session = self._session()
        if session is None:
            return {}
        try:
            return read_assessment(session, self._controller.cell)
        except ProtocolError as error:
            self._note = f"no assessment: {error}"
            return {}

    def _late_or_left_out(self) -> int:
        pacer = self._pacer
        return pacer.late + pacer.missed if pacer else 0

    def _result(self, joints: dict[str, JointFigures]) -> RunResult:
        controller, pacer = self._controller, self._pacer
        wall_s = (self._ended_ns - self._started_ns) * 1e-9
        virtual_s = (controller.tick + 1) * controller.loop.period_s
        return RunResult(
            state=controller.state,
            reason=controller.reason,
            ticks=controller.controlled_ticks,
            missed=self.missed,
            late=pacer.late if pacer else 0,
            real_time_factor=virtual_s / wall_s if controller.tick >= 0 and wall_s > 0.0 else 0.0,
            pacing=pacer,
            joints=joints,
            note=self._note,
            starved=self._starvation.of_the_run(controller.controlled_ticks + self.missed),
        )
