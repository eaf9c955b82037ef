"""The controller under test, without any input or output: frames and times go in, frames come out.

Owns the states of a run, from finding the cards to leaving them safe. Sockets, pacing and files belong to the runner.
The same object runs in a process of its own or inside a test.
"""

from collections.abc import Callable, Collection, Sequence
from enum import IntEnum

from canarm_protocol.canopen.dictionary import CODE_SHIFT, SYNC_OVERFLOW, default_value
from canarm_protocol.canopen.frames import Cob, Frame, NmtState, heartbeat_frame, sync_frame
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.model import SENSOR_KINDS, Cell, Quantity
from canarm_protocol.cell.wiring import CardNode, InputSlot, OutputFrames
from canarm_protocol.clock import Clock

from ..bus.master import Ask, Conversation, Silence, bring_up, read_input, start_frames, stop_frames
from ..errors import BringUpError, ControllerError, InterruptedRunError
from ..supervision.arm_watch import ArmWatch
from ..supervision.arrivals import Arrivals
from ..supervision.detection import DETECTORS, Detection, Reaction
from ..supervision.hold import SafeHold
from ..supervision.supervisor import Supervisor, Verdict
from .loop import OFF, ControlLoop

STANDSTILL_RAD_S = 0.06
"""Three steps of the tachometer: below this a joint stands still."""
STANDSTILL_CYCLES = 20
STOPPING_S = 2.0
"""A stop waits at most this long for standstill."""
FINAL_CYCLES = 2
"""A run that ends as planned needs two more SYNCs: the zero outputs of the first act at the second."""
MISSING_NOTED = DETECTORS["inputs-missing"].debounce_cycles
MEASURED = Quantity.POSITION, Quantity.VELOCITY, Quantity.CURRENT
SKEW_FRACTION = 5
"""An interval that is off by less than a fifth of a cycle is a cycle: at 2 rad/s it moves the angle by 0.05 LSB."""
CLEAR_CYCLES, UNCLEAR_ANSWERS = 4, 2
"""An answer that comes so many cycles late, or so long after the one before, follows a stall; it and the next may
belong to a SYNC before the stall or after it."""
REPEAT_CYCLES = 400
"""What is detected again and again at one place is noted once a second."""


class State(IntEnum):
    """States of a run, as published on the bench."""

    IDLE = 0
    BRINGING_UP = 1
    RUNNING = 2
    STOPPING = 3
    DONE = 4
    FAILED = 5

    def __str__(self) -> str:
        return self.name


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
        self.detections: list[Detection] = []
        """What has been noticed, oldest first; what stopped the robot is one of them."""
        self.on_detection: Callable[[Detection], None] | None = None
        """Called with every detection; may raise as `on_tick` may."""
        self.without: Collection[str] = ()
        """Names of detectors that are switched off."""
        self.starved_by: Callable[[str, str], str | None] = lambda detector, detail: None
        """Asked with every detection: the lack of computing time that explains it, as whoever owns the clock knows."""
        self._ticks = ticks
        self._nodes = nodes
        self._supervisor = Supervisor(cell, nodes)
        self._watch = ArmWatch(cell, loop.arm, loop.inputs.skew_s, loop.law.following_error_lsb, self._detect_at_joint)
        self._noted: dict[tuple[str, str | None], int] = {}
        self._holds = False
        self._hold: SafeHold | None = None
        self._arrived_ns = 0
        self._sync_ns: int | None = None
        self._sampled_ns: int | None = None
        self._excess_s = 0.0
        self._has_measured = False
        self._unclear_answers, self._unclear_s = 0, 0.0
        channels = [(joint, quantity) for joint in range(len(cell.joints)) for quantity in MEASURED]
        self._scan_ns = round(max(loop.inputs.skew_s(*channel) for channel in channels) * 1e9)
        self._missing_cycles = 0
        self._conversation: Conversation | None = self._prepare(listen_ns)
        self._ask: Ask | None = None
        self._outputs = OutputFrames(cell, nodes)
        self._layouts = {layout.cob_id: layout for node in nodes for layout in node.tpdos}
        self._places = {
            cob_id: [place for place, slot in enumerate(slots) if slot.cob_id == cob_id] for cob_id in self._layouts
        }
        self._slots = slots
        self._codes = [0] * len(slots)
        self._awaited = set(self._layouts)
        self._arrivals = Arrivals(self._layouts, self._detect_at_node)
        self._start_nodes = frozenset(node.card.node_id for node in nodes)
        self._node_id = cell.bus.controller_node_id
        self._heartbeat_cycles = max(1, cell.bus.heartbeat_ms * 1000 // cell.bus.cycle_us)
        self._counter_overflow = default_value(nodes[0].dictionary, SYNC_OVERFLOW)
        self._zero = self._outputs.pack([0] * len(cell.joints), [OFF] * len(cell.joints))
        self._stopping_cycles = 0
        self._still_cycles = 0

    @property
    def is_finished(self) -> bool:
        """Whether the run is over, well or badly."""
        return self.state in (State.DONE, State.FAILED)

    @property
    def reason(self) -> str | None:
        """Why the run failed or was stopped; None if it did as planned."""
        cause = self.error or self.verdict
        return None if cause is None else str(cause)

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
        layout = self._layouts.get(can_id)
        if layout is not None:
            if self.state >= State.RUNNING:
                self._arrived_ns = now_ns
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
            self._excess_s += supervisor.late_ns * 1e-9
            if self.state is State.RUNNING:
                self._detect("deadline-missed", None, f"SYNC was {supervisor.late_ns / 1e6:g} ms late")

    def _take_inputs(self, layout: PdoLayout, data: bytes) -> None:
        values = layout.unpack(data[: layout.size]) if len(data) >= layout.size else (-1,)
        if min(values) < 0:  # too short, or no code of a unipolar converter
            self.ignored_frames += 1
            return
        for place, value in zip(self._places[layout.cob_id], values, strict=True):
            self._codes[place] = value >> CODE_SHIFT
        if layout.cob_id in self._awaited:
            self._awaited.discard(layout.cob_id)
        elif self.state is State.RUNNING:
            self._arrivals.extra(layout.cob_id)
        if not self._awaited and self.cycle_is_open and self.clock is Clock.WALL:
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
        self._sync_ns = now_ns
        self._arrivals.open_cycle(self._awaited if self.tick else ())
        if self.tick % self._heartbeat_cycles == 0:
            self.outbox.append(heartbeat_frame(self._node_id, NmtState.OPERATIONAL))
        self.outbox.append(sync_frame(self.tick % self._counter_overflow + 1 if self._counter_overflow else None))
        self._awaited = set(self._layouts)
        self.cycle_is_open = True

    def close_cycle(self) -> None:
        """End a cycle: from its inputs to the outputs that act at the next SYNC."""
        self.cycle_is_open = False
        if self._ticks is not None and self.controlled_ticks >= self._ticks:
            self.end()
        if self.state is State.RUNNING:
            if self._awaited and self.clock is Clock.SYNC:
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
            self._judge(_law_verdict(error))
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
        if not self._awaited:
            self._measure()
        else:
            self._watch.coast(loop.cycle)
        if self.state is State.RUNNING:
            loop.look_up(self.tick)
            self._watch.follow(loop.cycle)
        if self.state is State.RUNNING:
            torque_nm = self._law_output()
            if torque_nm is not None:
                self.outbox += [Frame(cob_id, data) for cob_id, data in self._outputs.pack(*loop.outputs(torque_nm))]
                self.controlled_ticks += 1
                if self.on_tick is not None:
                    self.guard(self.on_tick)

    def _measure(self) -> None:
        """Take and judge what the cards have measured."""
        loop, watch = self.loop, self._watch
        loop.measure(self._codes, self.tick)
        if not self._has_measured:
            self._has_measured = True
            if not self._stands_still():  # it still falls from the last run
                self._unclear_answers = UNCLEAR_ANSWERS
        is_on_time = not self._excess_s if self.clock is Clock.SYNC else self._is_on_time()
        is_unclear = self._unclear_answers > 0
        if self.state is State.RUNNING:
            left_out = (self._unclear_s if is_unclear else max(self._excess_s, 0.0)) / loop.period_s
            self._judge(self._supervisor.measurement(loop.cycle.position_rad, left_out))
        if is_on_time and not is_unclear:
            watch.step(loop.cycle, loop.inputs.angle_codes, loop.inputs.speed_codes, loop.inputs.current_codes)
        else:
            watch.glimpse(loop.cycle, loop.inputs.angle_codes, loop.inputs.speed_codes, self._excess_s, is_unclear)
            self._excess_s = 0.0
            self._unclear_answers -= is_unclear
        self._missing_cycles = 0

    def _stands_still(self) -> bool:
        return all(abs(speed) < STANDSTILL_RAD_S for speed in self.loop.cycle.velocity_rad_s)

    def _is_on_time(self) -> bool:
        """Whether these inputs were sampled a cycle after the last.

        They are sampled when the cards get SYNC: if the answer comes soon, that is when it was sent; one that comes
        before the scan can be over is the last cycle's. How much more or less than a cycle has passed since the last,
        less what was predicted meanwhile, must not be lost in any case: `_excess_s` is added up, so that angles
        integrated over many cycles stay right.

        After a stall, of this machine or of the cards, nobody knows which SYNC the next answers belong to.
        """
        period_ns = self.cell.bus.cycle_ns
        sync_ns = self._arrived_ns if self._sync_ns is None else self._sync_ns
        is_old = self._sync_ns is not None and self._arrived_ns - sync_ns < self._scan_ns
        sampled_ns = sync_ns - period_ns if is_old else sync_ns
        last_ns, self._sampled_ns = self._sampled_ns, sampled_ns
        predicted = self._missing_cycles
        excess_ns = 0 if last_ns is None else sampled_ns - last_ns - (1 + predicted) * period_ns
        self._excess_s = excess_ns * 1e-9
        unclear_ns = max(excess_ns, self._arrived_ns - sampled_ns)
        if unclear_ns > CLEAR_CYCLES * period_ns:
            self._unclear_answers, self._unclear_s = UNCLEAR_ANSWERS, unclear_ns * 1e-9
        is_cycle = not predicted and abs(excess_ns) * SKEW_FRACTION < period_ns
        is_on_time = is_cycle and not is_old and 2 * (self._arrived_ns - sampled_ns) < period_ns
        if is_on_time and excess_ns:
            self._watch.shift(self._excess_s)
        return is_on_time

    def _law_output(self) -> Sequence[float] | None:
        """The law's torques, once they are found to be usable."""
        try:
            torque_nm = self.loop.torque_nm()
        except ControllerError as error:
            self._judge(_law_verdict(error))
            return None
        verdict = self._supervisor.command(torque_nm)
        self._judge(verdict)
        return [float(torque) for torque in torque_nm] if verdict is None else None

    def _miss(self) -> None:
        if self.state is State.RUNNING:
            self.missed += 1
            late = [f"TPDO 0x{cob_id:03X} of node 0x{cob_id & 0x7F:02X}" for cob_id in sorted(self._awaited)]
            waiting_for = " and ".join(late)
            self._missing_cycles += 1
            if self._missing_cycles == MISSING_NOTED:
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
        key = detector, where
        is_new = self.tick - self._noted.get(key, -REPEAT_CYCLES) >= REPEAT_CYCLES or (
            reaction.stops and self.state is State.RUNNING
        )
        self._noted[key] = self.tick
        if is_new and self.state in (State.RUNNING, State.STOPPING):
            detection = Detection(detector, where, max(self.tick, 0), detail, reaction)
            self.detections.append(detection)
            self._tell_detection(detection)
        if reaction.stops and self.state is State.RUNNING:
            self.verdict = Verdict(detector, detail, where)
            self.state = State.STOPPING
            self._holds = reaction is Reaction.HOLD
        elif reaction is Reaction.OFF:
            self._holds = False
        return True

    def _tell_detection(self, detection: Detection) -> None:
        if self.on_detection is not None:
            try:
                self.on_detection(detection)
            except OSError as error:
                self._judge(Verdict("recording-failed", str(error)))

    def _stop_step(self) -> None:
        """Torque off, or the arm held; the cycle goes on until it stands still, so that somebody watches it."""
        self._stopping_cycles += 1
        loop = self.loop
        if not self._awaited:
            if self._stopping_cycles > 1 or not self._holds:
                if self._holds:
                    self._measure()
                else:
                    loop.measure(self._codes, self.tick)
            self._still_cycles = self._still_cycles + 1 if self._stands_still() else 0
        limit = FINAL_CYCLES if self.verdict is None else int(STOPPING_S / loop.period_s)
        is_over = self._stopping_cycles > limit or (
            self.verdict is not None and self._still_cycles >= STANDSTILL_CYCLES
        )
        if self._holds and not is_over and not self._awaited:
            if self._hold is None:
                self._hold = SafeHold(loop.arm, loop.cycle, [each.bias for each in self._watch.joints], loop.period_s)
            torque_nm = self._hold.torque_nm(loop.cycle)
            self.outbox += [Frame(cob_id, data) for cob_id, data in self._outputs.pack(*loop.outputs(torque_nm))]
        elif is_over and self._holds:
            self._holds = False
            self._stopping_cycles = int(STOPPING_S / loop.period_s) - FINAL_CYCLES
            self._still_cycles = 0
            self.outbox += [Frame(cob_id, data) for cob_id, data in self._zero]
        elif is_over:
            self.outbox += stop_frames(self._nodes)
            self.state = State.DONE if self.verdict is None else State.FAILED
        else:
            self.outbox += [Frame(cob_id, data) for cob_id, data in self._zero]


def _law_verdict(error: ControllerError) -> Verdict:
    """Ctrl-C may find the law at work: then the user has stopped the robot, not the law."""
    return Verdict("interrupted" if isinstance(error, InterruptedRunError) else "law-failed", str(error))
