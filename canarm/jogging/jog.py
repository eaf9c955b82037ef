"""Driving the cards by hand, without any input or output: commands and frames go in, frames and lines of text come out.

`Jog` is the CANopen master of a bus that has no other. It owns the commanded outputs and what the cards sent
last; bus and wall clock belong to `driver`, the prompt to `canarm.commands.jog`.
"""

import contextlib
import math
from collections.abc import Generator

from canarm_controller.bus.master import Ask, Silence, bring_up, read_input, start_frames, stop_frames
from canarm_controller.run.pacing import Pacer
from canarm_controller.supervision.supervisor import Supervisor, Verdict
from canarm_protocol.canopen.frames import Cob, ErrorCode, Frame, NmtState, heartbeat_frame, sync_frame
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.configuration import SYNC_COUNTER
from canarm_protocol.cell.model import Cell, Quantity
from canarm_protocol.cell.output_frames import OutputFrames
from canarm_protocol.cell.sensing import joint_sensors
from canarm_protocol.cell.wiring import CardNode, DirectionBits, InputSlot, input_slots
from canarm_protocol.clock import Clock

from .cards import JogError, access_object, error_register, input_text, output_text, read_outputs
from .parsing import (
    AllOff,
    Command,
    Drive,
    PreOperational,
    Read,
    Reset,
    SdoRead,
    SdoWrite,
    ShowState,
    Start,
    Step,
    Stop,
    help_lines,
)

Work = Generator[Ask, Frame, list[str]]
"""A command being carried out: yields what to send and await (`Ask`, see `master`), returns the lines to show."""

TIME_NS = 2_000_000_000
"""How long to wait for TIME in lockstep."""
PATIENT_NS = 1_000_000_000
"""How long a reading on the wall clock is waited for: a busy machine answers late, and nobody is in a hurry."""
IDLE_HEARTBEAT_NS = 100_000_000
"""In lockstep no time passes for the cards between commands; this is often enough for another controller to hear us."""


class Jog:
    """The master. Its driver sets `now_ns`, hands in every frame, and sends the frames in `outbox`.

    `is_driving`: we have put the cards into OPERATIONAL. `is_over`: the bus has another master.
    """

    def __init__(self, cell: Cell, nodes: tuple[CardNode, ...], clock: Clock) -> None:
        self.cell, self.clock = cell, clock
        self.now_ns = 0
        self.outbox: list[Frame] = []
        self.is_driving = self.is_over = False
        self.cycle = -1
        """The last SYNC's number since start; -1 before the first."""
        self.codes = [0] * len(cell.joints)
        self.directions = [DirectionBits.OFF] * len(cell.joints)
        self._nodes = nodes
        self._slots = input_slots(cell, nodes)
        self._inputs: dict[InputSlot, int] = {}
        self._layouts = {layout.cob_id: layout for node in nodes for layout in node.tpdos}
        self._outputs = OutputFrames(cell, nodes)
        self._are_sent = False
        self._awaited: set[int] = set()
        self._states: dict[int, NmtState] = {}
        self._supervisor = Supervisor(cell, nodes)
        self._alarm: str | None = None
        self.is_stepping = self.is_interrupted = False
        self._has_cards = False
        self._node_id = cell.bus.controller_node_id
        self._heartbeat_ns = cell.bus.heartbeat_ms * 1_000_000
        self._heartbeat_cycles = max(1, cell.bus.heartbeat_ms * 1000 // cell.bus.cycle_us)
        self._next_heartbeat_ns: int | None = None
        self._overflow = SYNC_COUNTER

    def begin(self, listen_ns: int) -> Work:
        """Listen for another controller, then find, check, configure and start the cards. Raises `ControllerError`."""
        yield from bring_up(self._nodes, self.cell.bus, self.clock.value, listen_ns)
        self._has_cards = True
        self._enter(NmtState.PRE_OPERATIONAL)
        yield from self._read_inputs()
        return self._start()

    def end(self) -> list[Frame]:
        """The frames that leave the cards safe; none while they are not ours."""
        if not self._has_cards:
            return []
        self._drop_outputs()
        return stop_frames(self._nodes)

    def receive(self, frame: Frame, now_ns: int) -> None:
        """Take one frame from the bus. An alarm switches the outputs off and is raised by the next command."""
        self.now_ns = now_ns
        can_id, data, is_extended, is_remote = frame
        if is_extended or is_remote or not self._has_cards:
            return
        layout = self._layouts.get(can_id)
        if layout is not None:
            self._take_inputs(layout, data)
            return
        if can_id in (Cob.SYNC, Cob.HEARTBEAT + self._node_id):
            self.is_over = True
            self._raise_alarm("another controller is on the bus")
        elif can_id - Cob.HEARTBEAT in self._states and len(data) == 1 and data[0] in set(NmtState):
            self._states[can_id - Cob.HEARTBEAT] = NmtState(data[0])
        if self.is_driving:
            self._judge(self._supervisor.message(frame, self.cycle), frame)
            if can_id == Cob.TIME and self.clock is Clock.SYNC and self._is_off_beat(data):
                self._raise_alarm("virtual time did not move by a cycle: somebody else moves it, or it ran on")

    def _is_off_beat(self, time: bytes) -> bool:
        """Whether virtual time moved by anything but one cycle since our last SYNC: then somebody else moves it."""
        return self._supervisor.time(time) is not None or bool(self._supervisor.late_ns)

    def heartbeat_if_due(self) -> list[Frame]:
        """Our heartbeat if one is due: from the first start to the end."""
        if self._next_heartbeat_ns is None or self.now_ns < self._next_heartbeat_ns:
            return []
        return [self._heartbeat()]

    def run(self, command: Command) -> Work:
        """Carry out one command other than `Quit`. Raises `JogError`, or another `ControllerError` of the master.

        If the cards went safe meanwhile, its lines are not shown.
        """
        self.check()
        try:
            lines = yield from self._obey(command)
        finally:
            self.is_stepping = False
        self.check()
        return lines

    def check(self) -> None:
        """Raises `JogError` for an alarm since the last check."""
        alarm, self._alarm = self._alarm, None
        if alarm is not None:
            raise JogError(alarm)

    def interrupt(self) -> None:
        """End the running `step` after its present cycle."""
        self.is_interrupted = True

    def _obey(self, command: Command) -> Work:
        match command:
            case Drive() | AllOff():
                return self._drive(command)
            case Step(cycles):
                return (yield from self._step(cycles))
            case Read():
                return (yield from self._read())
            case ShowState():
                return (yield from self._show_state())
            case SdoRead() | SdoWrite():
                self._refuse_if_stopped()
                return [(yield from access_object(command))]
            case Start():
                return self._start()
            case Stop():
                return self._leave(NmtState.STOPPED)
            case PreOperational():
                return self._leave(NmtState.PRE_OPERATIONAL)
            case Reset():
                self._drop_outputs()
                yield from bring_up(self._nodes, self.cell.bus, self.clock.value, 0)
                self._enter(NmtState.PRE_OPERATIONAL)
                return ["cards are reset and configured, in PRE-OPERATIONAL"]
            case _:
                return help_lines()

    def _drive(self, command: Drive | AllOff) -> list[str]:
        if not self.is_driving:
            raise JogError("the cards are not in OPERATIONAL, nothing is set; type: start")
        self._are_sent = False
        if isinstance(command, AllOff):
            self.codes = [0] * len(self.codes)
            self.directions = [DirectionBits.OFF] * len(self.codes)
            return ["all outputs are off from the next step"]
        joint = command.joint
        if command.code is not None:
            self.codes[joint] = command.code
        if command.direction is not None:
            self.directions[joint] = command.direction
        text = output_text(self.cell, joint, self.codes[joint], self.directions[joint])
        return [f"{text}, from the next step"]

    def _start(self) -> list[str]:
        if self.is_driving:
            raise JogError("the cards are in OPERATIONAL already")
        self._drop_outputs()
        self.cycle = -1
        self._supervisor = Supervisor(self.cell, self._nodes)
        self.outbox += start_frames(self._nodes, self._node_id)
        self._next_heartbeat_ns = self.now_ns + self._heartbeat_ns
        self._enter(NmtState.OPERATIONAL)
        self.is_driving = True
        return ["cards are in OPERATIONAL, outputs off"]

    def _leave(self, state: NmtState) -> list[str]:
        frames = stop_frames(self._nodes)
        self.outbox += frames[: len(self._nodes)] if state is NmtState.STOPPED else frames
        self._drop_outputs()
        self._enter(state)
        return [f"cards are in {_spell(state)}, outputs off"]

    def _step(self, cycles: int) -> Work:
        pacer = Pacer(self.cell.bus.cycle_ns, lambda: self.now_ns)
        watch = Supervisor(self.cell, self._nodes)
        silent, first = 0, self.cycle + 1
        self.is_stepping, self.is_interrupted = True, False
        for _ in range(cycles):
            if self.is_interrupted:
                break
            yield from self._one_cycle(pacer, with_outputs=self.is_driving)
            if self.is_driving:
                silent += bool(self._awaited)
                late = " and ".join(f"TPDO 0x{cob_id:03X}" for cob_id in sorted(self._awaited))
                self._judge(
                    watch.missing(late, is_timed=self.clock is Clock.WALL)
                    if late
                    else watch.measurement(self._positions_rad())
                )
            self.check()
        text = f"cycle {self.cycle}"
        if self.clock is Clock.SYNC:
            text += f", {self.cycle * self.cell.bus.cycle_s * 1e3:g} ms"
        if self.is_driving:
            angles = zip(self.cell.joint_names, self._positions_rad(), strict=True)
            text += ": " + ", ".join(f"{name} {math.degrees(angle):.1f} deg" for name, angle in angles)
        else:
            text += ": nothing is driven, the cards are not in OPERATIONAL; type: start"
        if self.is_interrupted:
            text += f"; interrupted after {self.cycle + 1 - first} of {cycles} cycles"
        if silent:
            text += f"; {silent} cycles without all inputs"
        if pacer.late:
            text += f"; {pacer.late} cycles late, {pacer.missed} left out"
        return [text]

    def _one_cycle(self, pacer: Pacer, with_outputs: bool) -> Generator[Ask, Frame, None]:
        """One SYNC and what follows it: to TIME in lockstep, to the end of the period on the wall clock."""
        frames = []
        self.cycle += 1
        is_due = self._next_heartbeat_ns is not None and self.cycle % self._heartbeat_cycles == 0
        if self.clock is Clock.SYNC and is_due:
            frames.append(self._heartbeat())
        if with_outputs and not self._are_sent:
            frames += self._outputs.frames(self.codes, self.directions)
            self._are_sent = True
        frames.append(sync_frame(self.cycle % self._overflow + 1 if self._overflow else None))
        self._awaited = set(self._layouts) if self.is_driving else set()
        if self.clock is Clock.SYNC:
            try:
                yield Ask(tuple(frames), lambda frame: frame.can_id == Cob.TIME, TIME_NS)
            except Silence:
                self._raise_alarm(f"no TIME within {TIME_NS / 1e9:g} s of SYNC: does the emulator still run?")
        else:
            pacer.begin()
            with contextlib.suppress(Silence):
                yield Ask(tuple(frames), lambda frame: False, max(pacer.next_ns - self.now_ns, 0))

    def _read(self) -> Work:
        """In OPERATIONAL inputs are converted only at SYNC: on the wall clock one is sent, before pending outputs."""
        if self.is_driving and self.clock is Clock.WALL:
            yield from self._one_cycle(Pacer(self.cell.bus.cycle_ns, lambda: self.now_ns), with_outputs=False)
            self.check()
            if self._awaited:
                with contextlib.suppress(Silence):
                    yield Ask((), lambda frame: not self._awaited, PATIENT_NS)
                self.check()
            if self._awaited:
                missing = ", ".join(map(hex, sorted(self._awaited)))
                raise JogError(f"inputs did not come within {PATIENT_NS / 1e9:g} s of SYNC: {missing}")
        else:
            yield from self._read_inputs()
        slots = sorted(self._slots, key=lambda slot: slot.joint)
        return [input_text(self.cell, slot, self._inputs[slot]) for slot in slots]

    def _read_inputs(self) -> Generator[Ask, Frame, None]:
        """Read all inputs by SDO."""
        self._refuse_if_stopped()
        for slot in self._slots:
            node = next(node for node in self._nodes if node.card.node_id == slot.node_id)
            layout = self._layouts[slot.cob_id]
            self._inputs[slot] = yield from read_input(node, layout.objects[slot.position].subindex)

    def _show_state(self) -> Work:
        cycle = "no cycle yet" if self.cycle < 0 else f"cycle {self.cycle}"
        lines = [f"clock {self.clock.name.lower()}, {cycle}"]
        is_stopped = NmtState.STOPPED in self._states.values()
        codes, directions = list(self.codes), list(self.directions)
        for node in self._nodes:
            name, node_id = node.card.name, node.card.node_id
            text = f"card {name} (0x{node_id:02X}): {_spell(self._states[node_id])}"
            if not is_stopped:
                text += f", error register 0x{(yield from error_register(node)):02X}"
                yield from read_outputs(self.cell, node, codes, directions)
            lines.append(text)
        for joint in range(len(self.cell.joints)):
            text = output_text(self.cell, joint, codes[joint], directions[joint])
            wanted = output_text(self.cell, joint, self.codes[joint], self.directions[joint])
            is_pending = self.is_driving and not self._are_sent and text != wanted
            lines.append(f"{text}; from the next step {wanted}" if is_pending else text)
        return lines

    def _refuse_if_stopped(self) -> None:
        if NmtState.STOPPED in self._states.values():
            raise JogError("the cards are STOPPED and answer no SDO; type: preop")

    def _take_inputs(self, layout: PdoLayout, data: bytes) -> None:
        if len(data) < layout.size:
            return
        values = layout.unpack(data[: layout.size])
        slots = [slot for slot in self._slots if slot.cob_id == layout.cob_id]
        if any(values[slot.position] < slot.codec.lowest_value for slot in slots):  # no code of the converter
            return
        for slot in slots:
            self._inputs[slot] = slot.codec.code(values[slot.position])
        self._awaited.discard(layout.cob_id)

    def _positions_rad(self) -> list[float]:
        angles, sensors = [0.0] * len(self.cell.joints), joint_sensors(self.cell)
        for slot in self._slots:
            if slot.quantity is Quantity.POSITION:
                angles[slot.joint] = sensors[slot.joint].position.scale(self._inputs[slot])
        return angles

    def _heartbeat(self) -> Frame:
        self._next_heartbeat_ns = self.now_ns + (self._heartbeat_ns if self.clock is Clock.WALL else IDLE_HEARTBEAT_NS)
        return heartbeat_frame(self._node_id, NmtState.OPERATIONAL)

    def _enter(self, state: NmtState) -> None:
        self._states = {node.card.node_id: state for node in self._nodes}

    def _drop_outputs(self) -> None:
        self.is_driving = self._are_sent = False
        self.codes = [0] * len(self.codes)
        self.directions = [DirectionBits.OFF] * len(self.directions)

    def _judge(self, verdict: Verdict | None, frame: Frame | None = None) -> None:
        if verdict is None or self._alarm is not None:
            return
        text = verdict.detail
        is_lost = frame is not None and frame.data[:2] == ErrorCode.LIFE_GUARD_OR_HEARTBEAT.to_bytes(2, "little")
        if is_lost and self.clock is Clock.SYNC:
            name, _, _ = text.partition(", it missed")
            text = f"{name} (nothing came for the emulator's --sync-timeout; for work by hand: --sync-timeout 3600)"
        self._raise_alarm(text)

    def _raise_alarm(self, text: str) -> None:
        """Outputs off, cards in PRE-OPERATIONAL; the present or the next command reports `text`."""
        if self._alarm is None:
            self._alarm = f"{text}; outputs are off"
            self.outbox += stop_frames(self._nodes)
            self._drop_outputs()
            self._enter(NmtState.PRE_OPERATIONAL)


def _spell(state: NmtState) -> str:
    return state.name.replace("_", "-")
