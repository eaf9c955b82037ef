"""Judges cards, messages, measurements and commands of a run.

Owns thresholds and verdicts, not the reaction: the controller turns a verdict into a safe stop.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite as _isfinite
from numbers import Real

import numpy as np

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID, Cob, Emergency, ErrorCode, Frame, NmtState, parse_time
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import joint_sensors
from canarm_protocol.cell.wiring import CardNode
from canarm_protocol.errors import FrameError

from ..errors import ControllerError, InterruptedRunError
from ..laws.failure import shown
from .detection import Reaction
from .nominal import sensor_nominal
from .thresholds import longest_step_rad, missing_cycles, range_rad, silent_cycles

FOREIGN_MASTER = "foreign-master"
_SYNC, _HEARTBEAT, _EMERGENCY, _OPERATIONAL = (
    int(Cob.SYNC),
    int(Cob.HEARTBEAT),
    int(Cob.EMERGENCY),
    NmtState.OPERATIONAL,
)
TIME_STEP_NS = 1_000_000
"""TIME counts milliseconds."""
LATEST_NS = 1_000_000_000
"""A TIME further ahead than this comes from another producer, not from a late SYNC."""
OUTPUT_TYPES = (list, tuple, np.ndarray)
"""Types that a law may return. Others are iterable too, but a dict would give its keys."""
SHOWN = 80
"""Characters shown of a law's wrong result."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Why the robot must stop: the detector's name, and its finding."""

    detector: str
    detail: str
    where: str | None = None
    """Name of the joint or card concerned; None for the run as a whole."""
    reaction: Reaction | None = None
    """If it is not the table's."""

    def __str__(self) -> str:
        return f"{self.detector}: {self.detail}"


BUSY_MACHINE = "a busy machine, or a broken line? In lockstep (--clock sync) a busy machine does no harm"
EMERGENCIES: dict[int, str] = {
    ErrorCode.LIFE_GUARD_OR_HEARTBEAT: f", it missed this controller's heartbeat: {BUSY_MACHINE}",
    ErrorCode.OUTPUT_REFUSED: ", it was told to turn a joint both ways at once (direction bits 11)",
}
"""Meaning of emergency codes in the reason of a stop."""


class Supervisor:
    """Watches cards, measurements and commands of a run. Every method returns a verdict, or None while all is well."""

    def __init__(self, cell: Cell, nodes: Sequence[CardNode]) -> None:
        bus, limits = cell.bus, cell.supervision
        self._names = cell.joint_names
        self._cards = {node.card.node_id: node.card.name for node in nodes}
        self._controller_heartbeat = Cob.HEARTBEAT + bus.controller_node_id
        self._timeout_cycles = math.ceil(bus.heartbeat_timeout_ms * 1000 / bus.cycle_us)
        self._timeout_ms = bus.heartbeat_timeout_ms
        self._silent_ms = min(limits.silent_card_ms or self._timeout_ms, self._timeout_ms)
        self._silent_cycles = math.ceil(self._silent_ms * 1000 / bus.cycle_us)
        self._last_heartbeat = dict.fromkeys(self._cards, 0)
        self._heartbeat_before = dict(self._last_heartbeat)
        """The one before the last of each card."""
        self._heard = 0
        """No card's last heartbeat is older than this cycle."""
        self._started: set[int] = set()
        """Cards that have been seen in OPERATIONAL."""
        sensing = joint_sensors(cell)
        positions = [sensor_nominal(sensors.position) for sensors in sensing]
        self._impossible = [None if sensors.velocity else Reaction.OFF for sensors in sensing]
        """The reaction to what a joint's position sensor cannot show, if it is not to hold: with nothing to hold by."""
        joints = list(zip(cell.joints, positions, strict=True))
        self._range_rad = [range_rad(joint, position, limits) for joint, position in joints]
        self._max_step_rad = [
            longest_step_rad(position, joint.fastest_rad_s, limits, bus.cycle_s) for joint, position in joints
        ]
        self._bounds = [(*range_, step) for range_, step in zip(self._range_rad, self._max_step_rad, strict=True)]
        """Lowest and highest angle of each joint, and its longest step."""
        self._missing_limit = missing_cycles(limits, bus.cycle_s)
        self._silent_limit = silent_cycles(limits, bus.cycle_s)
        self._missing = self._silent = 0
        self._last_position: Sequence[float] | None = None
        self._cycle_ns = bus.cycle_ns
        self._first_time_ns: int | None = None
        self._last_time_ns = 0
        self._times = 0
        """Number of TIMEs since the first, or since the last late one."""
        self._late_cycles = 0
        self.late_ns = 0
        """How much longer than a cycle the last interval between TIMEs was; 0 if normal."""

    def message(self, frame: Frame, tick: int) -> Verdict | None:
        """Judge a frame that is not process data: heartbeats, emergencies, another master. Malformed ones may pass."""
        can_id = frame.can_id
        if can_id == _SYNC or can_id == self._controller_heartbeat:
            what = "SYNC" if can_id == _SYNC else "a heartbeat with our node-ID"
            return Verdict(FOREIGN_MASTER, f"{what} that we did not send: another controller is on the bus")
        node_id = can_id & HIGHEST_NODE_ID
        name = self._cards.get(node_id)
        if name is None:
            return None
        if can_id == _HEARTBEAT + node_id and len(frame.data) == 1:
            if frame.data[0] != _OPERATIONAL:
                if frame.data[0] == NmtState.PRE_OPERATIONAL and node_id not in self._started:
                    return None  # under way before NMT start took effect; `begin_cycle` limits how long
                state = NmtState(frame.data[0]).name if frame.data[0] in set(NmtState) else f"0x{frame.data[0]:02X}"
                detail = f"card {name!r} (node 0x{node_id:02X}) is in {state}, not OPERATIONAL"
                return Verdict("card-state", detail, name)
            self._started.add(node_id)
            self._heartbeat_before[node_id] = self._last_heartbeat[node_id]
            self._last_heartbeat[node_id] = tick
        elif can_id == _EMERGENCY + node_id:
            try:
                emergency = Emergency.parse(frame.data)
            except FrameError:
                return None
            if emergency.code:
                meaning = EMERGENCIES.get(emergency.code, "")
                return Verdict(
                    "card-emergency",
                    f"card {name!r} (node 0x{node_id:02X}) reports error 0x{emergency.code:04X}{meaning}",
                    name,
                )
        return None

    def time(self, data: bytes) -> Verdict | None:
        """Judge the TIME that ends a cycle in lockstep: virtual time advances by about a cycle from one to the next.

        A cycle ends when its inputs have arrived; with the wire's model that may be anywhere in the cycle, so an
        interval may be anything below two cycles. But virtual time cannot fall a whole cycle behind the number of
        cycles: then one of the TIMEs was not the emulator's, however well it fitted; milliseconds show it one cycle
        later at most. A TIME that is ahead says that the SYNC of its cycle was late, by `late_ns`: if it was another
        producer's, the emulator's next one goes back. `missing_cycles` late ones in a row are no cycle any more. The
        first TIME is taken as it is.
        """
        self.late_ns = 0
        try:
            time_ns = parse_time(data)
        except FrameError:
            return _foreign_time(f"{len(data)} bytes")
        if self._first_time_ns is None:
            self._first_time_ns = self._last_time_ns = time_ns
            return None
        step_ns = time_ns - self._last_time_ns
        self._last_time_ns = time_ns
        self._times += 1
        if not 0 <= step_ns <= self._cycle_ns + LATEST_NS + TIME_STEP_NS:
            return _foreign_time(f"{step_ns // TIME_STEP_NS} ms after the last one")
        if step_ns >= 2 * self._cycle_ns + TIME_STEP_NS:
            return self._late(step_ns)
        self._late_cycles = 0
        behind_ns = self._times * self._cycle_ns - (time_ns - self._first_time_ns)
        if behind_ns >= max(self._cycle_ns, TIME_STEP_NS):
            return _foreign_time(f"{behind_ns / TIME_STEP_NS:g} ms behind the cycles")
        return None

    def _late(self, step_ns: int) -> Verdict | None:
        """Cycles are counted again from a TIME that is ahead of them."""
        self.late_ns = step_ns - self._cycle_ns
        self._first_time_ns, self._times = self._last_time_ns, 0
        self._late_cycles += 1
        if self._late_cycles < self._missing_limit:
            return None
        return Verdict("deadline-missed", f"SYNC late in {self._late_cycles} cycles in a row")

    def begin_cycle(self, tick: int) -> Verdict | None:
        """Judge missing heartbeats of the cards.

        A card that is silent while another has been heard twice is missed sooner: a busy machine silences all.
        """
        if tick - self._heard <= self._silent_cycles:
            return None
        self._heard = min(self._last_heartbeat.values(), default=tick)
        for node_id, last in self._last_heartbeat.items():
            if tick - last > self._timeout_cycles:
                what = "silent" if node_id in self._started else "not in OPERATIONAL after NMT start"
                return Verdict(
                    "heartbeat-lost",
                    f"card {self._cards[node_id]!r} (node 0x{node_id:02X}) {what} for {self._timeout_ms} ms",
                    self._cards[node_id],
                )
        if self._silent_cycles == self._timeout_cycles:
            return None
        heard_twice = max(self._heartbeat_before.values())
        for node_id, last in self._last_heartbeat.items():
            if node_id in self._started and tick - last > self._silent_cycles and heard_twice > last:
                return Verdict(
                    "heartbeat-lost",
                    f"card {self._cards[node_id]!r} (node 0x{node_id:02X}) silent for {self._silent_ms} ms, "
                    "while other cards are heard",
                    self._cards[node_id],
                )
        return None

    def missing(self, waiting_for: str, *, is_timed: bool, is_part_silent: bool = False) -> Verdict | None:
        """A cycle ended without all of its inputs; `is_timed`: on the wall clock.

        `is_part_silent`: cards are silent while others are heard, which no busy machine explains: that stops sooner.
        """
        self._missing += 1
        self._silent = self._silent + 1 if is_part_silent else 0
        if self._silent >= self._silent_limit:
            return Verdict("inputs-missing", f"no {waiting_for} for {self._silent} cycles, while other cards are heard")
        if self._missing < self._missing_limit:
            return None
        hint = f": {BUSY_MACHINE}" if is_timed else ""
        return Verdict("inputs-missing", f"no {waiting_for} for {self._missing} cycles{hint}")

    def measurement(self, position_rad: Sequence[float], left_out: float = 0.0) -> Verdict | None:
        """Judge the measured joint angles: none beyond its stops, none faster than the arm can move.

        After cycles without a measurement, or `left_out` cycles without SYNC, it may have moved accordingly.
        """
        factor = 1 + self._missing + left_out
        self._missing = self._silent = 0
        last = self._last_position
        self._last_position = position_rad
        if last is not None:
            for (low, high, longest_rad), position, before in zip(self._bounds, position_rad, last, strict=True):
                longest_rad *= factor
                if not (low <= position <= high and -longest_rad <= position - before <= longest_rad):
                    break
            else:
                return None
        for joint, position in enumerate(position_rad):
            low, high = self._range_rad[joint]
            if not low <= position <= high:
                return Verdict(
                    "impossible-position",
                    f"{self._names[joint]} measured at {math.degrees(position):.1f} deg; "
                    f"its range is {math.degrees(low):.0f} to {math.degrees(high):.0f} deg",
                    self._names[joint],
                    self._impossible[joint],
                )
            longest_rad = self._max_step_rad[joint] * factor
            if last is not None and abs(position - last[joint]) > longest_rad:
                return Verdict(
                    "impossible-motion",
                    f"{self._names[joint]} measured {math.degrees(last[joint]):.1f} deg, then "
                    f"{math.degrees(position):.1f} deg; at most {math.degrees(longest_rad):.0f} deg is possible",
                    self._names[joint],
                    self._impossible[joint],
                )
        return None

    def command(self, torque_nm: Sequence[float]) -> Verdict | None:
        """Judge the law's result, whatever its type: a law can be the user's own."""
        if type(torque_nm) is list and len(torque_nm) == len(self._names):  # as nearly always
            for torque in torque_nm:
                if type(torque) is not float or not _isfinite(torque):
                    break
            else:
                return None
        try:
            finite = [_is_finite(torque) for torque in torque_nm] if isinstance(torque_nm, OUTPUT_TYPES) else None
        except (TypeError, OverflowError):
            finite = None
        if finite is None:
            text = shown(torque_nm, repr, SHOWN)
            return Verdict("law-output", f"the law returned {text}; must be {len(self._names)} torques in N m")
        count = len(finite)
        if count != len(self._names):
            return Verdict("law-output", f"the law returned {count} torques for {len(self._names)} joints")
        if not all(finite):
            joint = finite.index(False)
            return Verdict("law-output", f"the law asks for {torque_nm[joint]} N m at {self._names[joint]}")
        return None


def _is_finite(torque: object) -> bool:
    """Raises `TypeError` unless it is a real number, `OverflowError` for an int beyond the range of float."""
    if type(torque) is not float and not isinstance(torque, Real):  # an abstract class is slow to ask
        raise TypeError
    return _isfinite(torque)


def _foreign_time(what: str) -> Verdict:
    return Verdict(
        FOREIGN_MASTER, f"TIME that does not belong to this cycle ({what}): another producer of TIME is on the bus"
    )


def law_verdict(error: ControllerError) -> Verdict:
    """The verdict on an exception from a law's code. If it is from Ctrl-C, the user has stopped the robot."""
    return Verdict("interrupted" if isinstance(error, InterruptedRunError) else "law-failed", str(error))
