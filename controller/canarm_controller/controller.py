"""The controller under test, without any input or output: frames and times go in, frames come out.

Owns the states of a run, from finding the cards to leaving them safe. Sockets, pacing and files belong to the runner.
The same object runs in a process of its own or inside a test.
"""

from collections.abc import Callable, Sequence
from enum import IntEnum

from canarm_protocol.cell import Cell, Quantity
from canarm_protocol.clock import Clock
from canarm_protocol.dictionary import CODE_SHIFT, SYNC_OVERFLOW, default_value
from canarm_protocol.frames import Cob, Frame, NmtState, heartbeat_frame, sync_frame
from canarm_protocol.pdo import PdoLayout
from canarm_protocol.wiring import CardNode, InputSlot, OutputFrames

from .errors import BringUpError, ControllerError, InterruptedRunError
from .loop import OFF, ControlLoop
from .master import Ask, Conversation, Silence, bring_up, read_input, start_frames, stop_frames
from .supervisor import Supervisor, Verdict

STANDSTILL_RAD_S = 0.06
"""Three steps of the tachometer: below this a joint stands still."""
STANDSTILL_CYCLES = 20
STOPPING_S = 2.0
"""A stop waits at most this long for standstill."""
FINAL_CYCLES = 2
"""A run that ends as planned needs two more SYNCs: the zero outputs of the first act at the second."""


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
        self._ticks = ticks
        self._nodes = nodes
        self._supervisor = Supervisor(cell, nodes)
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

    def begin(self, now_ns: int) -> None:
        """Start finding the cards."""
        self.state = State.BRINGING_UP
        self._converse(None, now_ns)

    def receive(self, frame: Frame, now_ns: int) -> None:
        """Take one frame from the bus. A malformed or foreign one is counted in `ignored_frames`; it stops nothing.

        In lockstep every TIME ends a cycle. One that cannot be this cycle's begins the safe stop, to which a TIME too
        many does no harm.
        """
        can_id, data, is_extended, is_remote = frame
        if is_extended or is_remote:
            self.ignored_frames += 1
            return
        layout = self._layouts.get(can_id)
        if layout is not None:
            if self.state >= State.RUNNING:
                self._take_inputs(layout, data)
        elif can_id == Cob.TIME:
            if self.clock is Clock.SYNC and self.cycle_is_open:
                if self.state is State.RUNNING:
                    self._judge(self._supervisor.time(data))
                self.close_cycle()
                self.open_cycle()
        elif self._conversation is not None:
            if self._ask is not None and self._ask.is_answer(frame):
                self._converse(frame, now_ns)
        elif self.state is State.RUNNING:
            self._judge(self._supervisor.message(frame, self.tick))

    def _take_inputs(self, layout: PdoLayout, data: bytes) -> None:
        values = layout.unpack(data[: layout.size]) if len(data) >= layout.size else (-1,)
        if min(values) < 0:  # too short, or no code of a unipolar converter
            self.ignored_frames += 1
            return
        for place, value in zip(self._places[layout.cob_id], values, strict=True):
            self._codes[place] = value >> CODE_SHIFT
        self._awaited.discard(layout.cob_id)
        if not self._awaited and self.cycle_is_open and self.clock is Clock.WALL:
            self.close_cycle()

    def time_out(self, now_ns: int) -> None:
        """`deadline_ns` has passed without the awaited answer."""
        if self._conversation is not None and self.deadline_ns is not None:
            self._converse(None, now_ns, silent=True)

    def open_cycle(self) -> None:
        """Begin a cycle: SYNC goes out, after a heartbeat when one is due."""
        if self.cycle_is_open:
            self._miss()
            self.close_cycle()
        if self.is_finished or self.state is State.BRINGING_UP:
            return
        self.tick += 1
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
                if channel.quantity == Quantity.POTENTIOMETER:
                    code = yield from read_input(node, channel.number)
                    codes[self.cell.joint_names.index(channel.joint)] = code
        self.loop.begin(codes)

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
            loop.measure(self._codes, self.tick)
            self._judge(self._supervisor.measurement(loop.cycle.position_rad))
        if self.state is State.RUNNING:
            loop.look_up(self.tick)
            torque_nm = self._law_output()
            if torque_nm is not None:
                self.outbox += [Frame(cob_id, data) for cob_id, data in self._outputs.pack(*loop.outputs(torque_nm))]
                self.controlled_ticks += 1
                self._tell_tick()

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

    def _tell_tick(self) -> None:
        if self.on_tick is not None:
            try:
                self.on_tick()
            except ControllerError as error:
                self._judge(_law_verdict(error))
            except OSError as error:
                self._judge(Verdict("recording-failed", str(error)))

    def _miss(self) -> None:
        if self.state is State.RUNNING:
            self.missed += 1
            late = [f"TPDO 0x{cob_id:03X} of node 0x{cob_id & 0x7F:02X}" for cob_id in sorted(self._awaited)]
            self._judge(self._supervisor.missing(" and ".join(late)))

    def _judge(self, verdict: Verdict | None) -> None:
        if verdict is not None and self.state is State.RUNNING:
            self.verdict = verdict
            self.state = State.STOPPING

    def _stop_step(self) -> None:
        """Torque off; the cycle goes on until the arm stands still, so that somebody watches it."""
        self._stopping_cycles += 1
        if not self._awaited:
            self.loop.measure(self._codes, self.tick)
            still = all(abs(speed) < STANDSTILL_RAD_S for speed in self.loop.cycle.velocity_rad_s)
            self._still_cycles = self._still_cycles + 1 if still else 0
        limit = FINAL_CYCLES if self.verdict is None else int(STOPPING_S / self.loop.period_s)
        if self._stopping_cycles > limit or (self.verdict is not None and self._still_cycles >= STANDSTILL_CYCLES):
            self.outbox += stop_frames(self._nodes)
            self.state = State.DONE if self.verdict is None else State.FAILED
        else:
            self.outbox += [Frame(cob_id, data) for cob_id, data in self._zero]


def _law_verdict(error: ControllerError) -> Verdict:
    """Ctrl-C may find the law at work: then the user has stopped the robot, not the law."""
    return Verdict("interrupted" if isinstance(error, InterruptedRunError) else "law-failed", str(error))
