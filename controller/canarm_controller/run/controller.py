"""The controller under test, without any input or output: frames and times go in, frames come out.

Owns the states of a run, from finding the cards to leaving them safe. Sockets, pacing and files belong to the runner.
The same object runs in a process of its own or inside a test.
"""

from collections.abc import Callable, Collection, Sequence

from canarm_protocol.canopen.frames import Cob, Frame, NmtState, data_frame, heartbeat_frame, sync_frame
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.configuration import SYNC_COUNTER
from canarm_protocol.cell.model import SENSOR_KINDS, Cell, Quantity
from canarm_protocol.cell.wiring import CardNode, InputSlot, OutputFrames
from canarm_protocol.clock import Clock

from ..bus.master import Ask, Conversation, Silence, bring_up, read_input, start_frames, stop_frames
from ..errors import BringUpError, ControllerError
from ..supervision.arm_watch import ArmWatch
from ..supervision.arrivals import Arrivals
from ..supervision.detection import DETECTORS, Detection, Reaction
from ..supervision.supervisor import Supervisor, Verdict, law_verdict
from .awaited_inputs import AwaitedInputs
from .detection_log import DetectionLog
from .loop import OFF, ControlLoop
from .safe_stop import SafeStop, stands_still
from .sample_times import SampleTimes
from .state import State

ENDED = State.DONE, State.FAILED
MISSING_NOTED = DETECTORS["inputs-missing"].debounce_cycles
MEASURED = Quantity.POSITION, Quantity.VELOCITY, Quantity.CURRENT


class Controller:
    """One run. Whoever drives it hands in every frame, sends what gathers in `outbox`, and calls `open_cycle` on time.

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
        self.cell, self.loop, self.clock = cell, loop, clock
        self.state = State.IDLE
        self.outbox: list[Frame] = []
        self.tick = -1
        """The cycle that the last SYNC began; -1 before the first."""
        self.controlled_ticks = 0
        self.missed = 0
        """Cycles of the run, up to its stop, whose inputs were not complete in time."""
        self.ignored_frames = 0
        """Malformed process data, and frames that CANopen does not know: 29-bit identifiers, remote requests."""
        self.verdict: Verdict | None = None
        self.error: ControllerError | None = None
        self.deadline_ns: int | None = None
        """When `time_out` is to be called, in the time that is handed in; None while nothing is awaited."""
        self.cycle_is_open = False
        """Whether inputs of the cycle are still to come."""
        self.on_tick: Callable[[], None] | None = None
        self.on_detection: Callable[[Detection], None] | None = None
        """Called with every detection; may raise as `on_tick` may."""
        self.without: Collection[str] = ()
        """Names of detectors that are switched off."""
        self.starved_by: Callable[[str, str], str | None] = lambda detector, detail: None
        """Asked with every detection: the lack of computing time that explains it, as whoever owns the clock knows."""
        self._ticks = ticks
        self._nodes = nodes
        self._supervisor = Supervisor(cell, nodes)
        self._watch = ArmWatch(cell, loop.arm, loop.law.following_error_lsb, self._detect_at_joint)
        self._log = DetectionLog()
        self._stop = SafeStop(loop, self._watch.safe_hold, self._watch.standing_rad_s)
        self._has_measured = False
        channels = [(joint, quantity) for joint in range(len(cell.joints)) for quantity in MEASURED]
        scan_ns = round(max(loop.inputs.skew_s(*channel) for channel in channels) * 1e9)
        self._times = SampleTimes(clock, cell.bus.cycle_ns, scan_ns)
        self._conversation: Conversation | None = self._prepare(listen_ns)
        self._ask: Ask | None = None
        self._outputs = OutputFrames(cell, nodes)
        self._inputs = AwaitedInputs(nodes, slots)
        self._arrivals = Arrivals(self._inputs.layouts, self._detect_at_node)
        self._node_id = cell.bus.controller_node_id
        self._heartbeat_cycles = max(1, cell.bus.heartbeat_ms * 1000 // cell.bus.cycle_us)
        self._counter_overflow = SYNC_COUNTER
        self._zero = self._outputs.pack([0] * len(cell.joints), [OFF] * len(cell.joints))

    @property
    def is_finished(self) -> bool:
        """Whether the run is over, well or badly."""
        return self.state in ENDED

    @property
    def reason(self) -> str | None:
        """Why the run failed or was stopped; None if it did as planned."""
        cause = self.error or self.verdict
        return None if cause is None else str(cause)

    @property
    def detections(self) -> list[Detection]:
        """What has been noticed, oldest first; what stopped the robot is one of them."""
        return self._log.entries

    @property
    def degraded(self) -> list[Detection]:
        """Detections with which the run went on, less able than before; empty while all is well."""
        return [each for each in self.detections if each.reaction in (Reaction.DEGRADED, Reaction.SUBSTITUTE)]

    def begin(self, now_ns: int) -> None:
        """Start finding the cards."""
        self.state = State.BRINGING_UP
        self._converse(None, now_ns)

    def receive(self, frame: Frame, now_ns: int) -> None:
        """Take one frame from the bus. A malformed or foreign one is counted in `ignored_frames`; it stops nothing.

        In lockstep every TIME ends a cycle. One that is ahead of it says that its SYNC was late. One that cannot be
        this cycle's begins the safe stop, to which a TIME too many does no harm.
        """
        can_id, data, is_extended, is_remote = frame
        if is_extended or is_remote:
            self.ignored_frames += 1
            return
        layout = self._inputs.layouts.get(can_id)
        if layout is not None:
            if self.state >= State.RUNNING:
                self._times.arrive(now_ns)
                self._take_inputs(layout, data)
        elif can_id == Cob.TIME:
            if self.clock is Clock.SYNC and self.cycle_is_open:
                if self.state is State.RUNNING:
                    self._take_time(data)
                self.close_cycle()
                self.open_cycle()
        elif self._conversation is not None:
            if self._ask is not None and self._ask.is_answer(frame):
                self._converse(frame, now_ns)
        elif self.state is State.RUNNING or self.verdict is not None:
            self._judge(self._supervisor.message(frame, self.tick))

    def _take_time(self, data: bytes) -> None:
        """In lockstep: judge the TIME, and keep by how much the next measurement is later than a cycle."""
        supervisor = self._supervisor
        self._judge(supervisor.time(data))
        if supervisor.late_ns:
            self._times.delay(supervisor.late_ns)
            if self.state is State.RUNNING:
                self._detect("deadline-missed", None, f"SYNC was {supervisor.late_ns / 1e6:g} ms late")

    def _take_inputs(self, layout: PdoLayout, data: bytes) -> None:
        inputs = self._inputs
        if not inputs.take(layout, data):
            self.ignored_frames += 1
            return
        if layout.cob_id in inputs.awaited:
            inputs.awaited.discard(layout.cob_id)
        elif self.state is State.RUNNING:
            self._arrivals.extra(layout.cob_id)
        if not inputs.awaited and self.cycle_is_open and self.clock is Clock.WALL:
            self.close_cycle()

    def time_out(self, now_ns: int) -> None:
        """`deadline_ns` has passed without the awaited answer."""
        if self._conversation is not None and self.deadline_ns is not None:
            self._converse(None, now_ns, silent=True)

    def open_cycle(self, now_ns: int | None = None) -> None:
        """Begin a cycle: SYNC goes out, after a heartbeat when one is due.

        On the wall clock `now_ns` says when, in the time that `receive` is given: cycles are seldom of one length.
        """
        if self.cycle_is_open:
            self._miss()
            self.close_cycle()
        if self.is_finished or self.state is State.BRINGING_UP:
            return
        self.tick += 1
        self._times.open_cycle(now_ns)
        self._arrivals.open_cycle(self._inputs.awaited if self.tick else ())
        if self.tick % self._heartbeat_cycles == 0:
            self.outbox.append(heartbeat_frame(self._node_id, NmtState.OPERATIONAL))
        self.outbox.append(sync_frame(self.tick % self._counter_overflow + 1 if self._counter_overflow else None))
        self._inputs.open_cycle()
        self.cycle_is_open = True

    def close_cycle(self) -> None:
        """End a cycle: from its inputs to the outputs that act at the next SYNC."""
        self.cycle_is_open = False
        if self._ticks is not None and self.controlled_ticks >= self._ticks:
            self.end()
        if self.state is State.RUNNING:
            if self._inputs.awaited and self.clock is Clock.SYNC:
                self._miss()
            if self.state is State.RUNNING:
                self._judge(self._supervisor.begin_cycle(self.tick))
            if self.state is State.RUNNING:
                self._control()
        if self.state is State.STOPPING:
            self._stop_step()

    def note_missed_deadlines(self, count: int) -> None:
        """Whoever paces the cycles has left out `count` of them: the wall clock was ahead."""
        if self.state is State.RUNNING:
            self._detect("deadline-missed", None, f"{count} cycles left out")

    def guard(self, tell: Callable[[], None]) -> None:
        """Call what records or reports the tick; what it fails with, as `on_tick` may, stops the robot safely."""
        try:
            tell()
        except ControllerError as error:
            self._judge(law_verdict(error))
        except OSError as error:
            self._judge(Verdict("recording-failed", str(error)))

    def interrupt(self, detail: str) -> None:
        """Stop safely because the user says so."""
        if self.state is State.RUNNING:
            self._judge(Verdict("interrupted", detail))
        elif not self.is_finished and self.state is not State.STOPPING:
            self.lose(ControllerError(f"interrupted: {detail}"))

    def end(self) -> None:
        """Stop as planned, before the last tick; a run that still looks for its cards ends when it has found them."""
        if self.state is State.RUNNING:
            self.state = State.STOPPING
        elif self.state is State.BRINGING_UP:
            self._ticks = 0
        elif self.state is State.IDLE:
            self.state = State.DONE

    def lose(self, error: ControllerError) -> None:
        """The bus is lost, or nobody answers any more: nothing can be sent; the cards protect themselves."""
        if not self.is_finished:
            self.error = self.error or error
            self.state = State.FAILED
            self.outbox.clear()
            self.cycle_is_open = False
            self.deadline_ns = self._conversation = self._ask = None

    def _prepare(self, listen_ns: int) -> Conversation:
        yield from bring_up(self._nodes, self.cell.bus, self.clock.value, listen_ns)
        codes = [0] * len(self.cell.joints)
        for node in self._nodes:
            for channel in node.card.channel:
                kind = SENSOR_KINDS.get(channel.leaf)
                if kind is not None and kind.quantity is Quantity.POSITION:
                    code = yield from read_input(node, channel.number)
                    codes[self.cell.far_joint(node.card, channel)] = code
        self.loop.begin(codes)
        if self._ticks is not None:
            self._ticks += round(self.loop.trajectory.approach_s / self.loop.period_s)
        self._watch.start(self.loop.cycle.position_rad)

    def _converse(self, answer: Frame | None, now_ns: int, silent: bool = False) -> None:
        conversation = self._conversation
        assert conversation is not None
        try:
            if silent:
                self._ask = conversation.throw(Silence())
            else:
                self._ask = conversation.send(answer) if answer is not None else next(conversation)
        except StopIteration:
            self._conversation = self._ask = None
            self.deadline_ns = None
            self.state = State.RUNNING
            self.outbox += start_frames(self._nodes, self._node_id)
            if self.clock is Clock.SYNC:
                self.open_cycle()
        except ControllerError as error:
            self._conversation = None
            self.lose(error)
            if not isinstance(error, BringUpError):
                self.outbox += stop_frames(self._nodes)
        else:
            self.outbox += self._ask.frames
            self.deadline_ns = now_ns + self._ask.limit_ns

    def _control(self) -> None:
        loop = self.loop
        if not self._inputs.awaited:
            self._measure()
        else:
            self._watch.coast(loop.cycle)
        if self.state is State.RUNNING:
            loop.look_up(self.tick)
            self._watch.follow(loop.cycle)
        if self.state is State.RUNNING:
            torque_nm = self._law_output()
            if torque_nm is not None:
                self.outbox += [
                    data_frame(cob_id, data) for cob_id, data in self._outputs.pack(*loop.outputs(torque_nm))
                ]
                self.controlled_ticks += 1
                if self.on_tick is not None:
                    self.guard(self.on_tick)

    def _measure(self) -> None:
        """Take and judge what the cards have measured."""
        loop, inputs, watch = self.loop, self.loop.inputs, self._watch
        loop.measure(self._inputs.codes, self.tick)
        if not self._has_measured:
            self._has_measured = True
            if not stands_still(loop.cycle, watch.standing_rad_s):  # it still falls from the last run
                self._times.mistrust()
        sample = self._times.take()
        if sample.shift_s:
            watch.shift(sample.shift_s)
        if self.state is State.RUNNING:
            left_out = sample.left_out_s / loop.period_s
            self._judge(self._supervisor.measurement(loop.cycle.position_rad, left_out))
        if sample.is_on_time:
            watch.step(loop.cycle, inputs.angle_codes, inputs.speed_codes, inputs.current_codes)
        else:
            watch.glimpse(loop.cycle, inputs.angle_codes, inputs.speed_codes, sample.excess_s, sample.is_unclear)

    def _law_output(self) -> Sequence[float] | None:
        """The law's torques, once they are found to be usable."""
        try:
            torque_nm = self.loop.torque_nm()
        except ControllerError as error:
            self._judge(law_verdict(error))
            return None
        verdict = self._supervisor.command(torque_nm)
        self._judge(verdict)
        return [float(torque) for torque in torque_nm] if verdict is None else None

    def _miss(self) -> None:
        if self.state is State.RUNNING:
            self.missed += 1
            waiting_for = self._inputs.describe_awaited()
            self._times.missing_cycles += 1
            if self._times.missing_cycles == MISSING_NOTED:
                self._detect("inputs-missing", None, f"no {waiting_for} for {MISSING_NOTED} cycles")
            self._judge(self._supervisor.missing(waiting_for, is_timed=self.clock is Clock.WALL))

    def _judge(self, verdict: Verdict | None) -> None:
        if verdict is not None and self.state in (State.RUNNING, State.STOPPING):
            row = DETECTORS[verdict.detector]
            reaction = row.reaction if row.reaction.stops else Reaction.OFF
            self._detect(verdict.detector, verdict.where, verdict.detail, reaction)

    def _detect_at_joint(self, detector: str, joint: int, detail: str, reaction: Reaction | None) -> bool:
        name = self.cell.joint_names[joint]
        return self._detect(detector, name, f"{name}: {detail}", reaction)

    def _detect_at_node(self, detector: str, node_id: int, detail: str, reaction: Reaction | None) -> bool:
        return self._detect(detector, f"0x{node_id:02X}", detail, reaction)

    def _detect(self, detector: str, where: str | None, detail: str, reaction: Reaction | None = None) -> bool:
        """Note what was noticed and react. False if the detector is switched off."""
        if detector in self.without:
            return False
        reaction = reaction or DETECTORS[detector].reaction
        if (cause := self.starved_by(detector, detail)) is not None:
            if not reaction.stops:
                return False
            detail = f"{cause}; {detector} followed from it"
            detector, where = "deadline-missed", None
        if self.state in (State.RUNNING, State.STOPPING):
            is_end = reaction.stops and self.state is State.RUNNING
            detection = self._log.note(Detection(detector, where, max(self.tick, 0), detail, reaction), is_end)
            if detection is not None:
                self._tell_detection(detection)
        if reaction.stops and self.state is State.RUNNING:
            self.verdict = Verdict(detector, detail, where)
            self.state = State.STOPPING
            self._stop.holds = reaction is Reaction.HOLD
        elif reaction is Reaction.OFF:
            self._stop.holds = False
        return True

    def _tell_detection(self, detection: Detection) -> None:
        if self.on_detection is not None:
            try:
                self.on_detection(detection)
            except OSError as error:
                self._judge(Verdict("recording-failed", str(error)))

    def _stop_step(self) -> None:
        """Torque off, or the arm held; the cycle goes on until it stands still, so that somebody watches it."""
        has_inputs = not self._inputs.awaited
        if self._stop.begin_cycle() and has_inputs:
            if self._stop.holds:
                self._measure()
            else:
                self.loop.measure(self._inputs.codes, self.tick)
        step = self._stop.step(self.verdict is None, has_inputs)
        if step.is_over:
            self.outbox += stop_frames(self._nodes)
            self.state = State.DONE if self.verdict is None else State.FAILED
        else:
            outputs = self._zero if step.torque_nm is None else self._outputs.pack(*self.loop.outputs(step.torque_nm))
            self.outbox += [data_frame(cob_id, data) for cob_id, data in outputs]
