"""Frames of the bench bus in, snapshots out: all that the dashboard knows of a run.

Sans-IO: wall time is passed in with every call, bus time comes with every frame. Nothing is drawn here.
"""

from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.canopen.frames import Cob, Frame
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.bench_objects import DIVIDER, INTERNALS, SDO_CHANNELS, bench_pdos, sdo_channel
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import position_steps_rad

from .faults import FaultSignal
from .rings import FIELDS, ReferenceRing, SampleRing
from .snapshot import Counters, JointNow, Rates, Report, Snapshot

WINDOW_S = 10.0
"""Traces and RMS cover this much of the run, in cycles of nominal length."""
MATCH_S = 0.5
"""A reference that lags the newest sample by more is no longer shown as current."""
RATE_WINDOW_NS = 2_000_000_000
_ANGLE, _SPEED, _CURRENT, _COMMAND = range(FIELDS)
_LIMIT_TOLERANCE = 1e-6
"""Commands travel as REAL32: a command at the limit differs from it by up to 6e-8 of its value."""


class _Mark(NamedTuple):
    """A sample's time on three clocks."""

    wall_ns: int
    bus_ns: int
    cycle: int


class _Window(NamedTuple):
    """Samples, oldest first: cycles (n,), values (n, joints, FIELDS), references (n, joints), errors (n, joints)."""

    cycles: NDArray[np.int64]
    values: NDArray[np.float64]
    references: NDArray[np.float64]
    error_lsb: NDArray[np.float64]


class Feed:
    """The state of the dashboard's data. A cycle or tick that goes backwards begins a new run."""

    def __init__(self, cell: Cell) -> None:
        joints = cell.joints
        self._cycle_s = cell.bus.cycle_s
        self._window = max(1, round(WINDOW_S / cell.bus.cycle_s))
        self._match = max(1, round(MATCH_S / cell.bus.cycle_s))
        self._lsb_rad = np.array(position_steps_rad(cell))
        self._limit_a = np.array([joint.drive.max_current_a for joint in joints]) * (1.0 - _LIMIT_TOLERANCE)
        self._samples = SampleRing(self._window, len(joints))
        self._references = ReferenceRing(2 * self._window, len(joints))
        self._row = [0.0] * (FIELDS * len(joints))
        self._row_parts = 0
        self._all_parts = (1 << 2 * len(joints)) - 1
        self._wall_ns = self._bus_ns = 0
        self._cycle: int | None = None
        self._cycle_ns = 0
        self._sample: tuple[int, int] | None = None
        self._idle: NDArray[np.float64] | None = None
        self._telemetry_wall_ns: int | None = None
        self._previous_ticks: list[int | None] = [None] * len(joints)
        self._marks: deque[_Mark] = deque()
        self._drawn: tuple[tuple[int, int], _Window] | None = None
        self._report: tuple[int, int, int] | None = None
        self._report_wall_ns = 0
        self.faults: FaultSignal | None = None
        """The bench's latest report of its faults since the bus was opened."""
        self._received = self._unknown = self._malformed = 0
        self._dropped_samples = self._dropped_references = 0
        self._reported = np.full((len(joints), 4), np.nan)
        self._internals = np.full((len(joints), INTERNALS), np.nan)
        self._handlers = self._make_handlers(cell)
        self._not_ours = _other_services(cell)

    def _make_handlers(self, cell: Cell) -> dict[int, tuple[PdoLayout, Callable[..., None]]]:
        pdos = bench_pdos(cell)
        handlers: dict[int, tuple[PdoLayout, Callable[..., None]]] = {
            pdos.status.cob_id: (pdos.status, self._on_status),
            pdos.controller.cob_id: (pdos.controller, self._on_controller),
            pdos.faults.cob_id: (pdos.faults, self._on_faults),
        }
        for joint in range(len(cell.joints)):
            place = FIELDS * joint
            parts = (
                (pdos.truth[joint], self._part(1 << 2 * joint, place + _ANGLE)),
                (pdos.drive[joint], self._part(2 << 2 * joint, place + _CURRENT)),
                (pdos.reference[joint], self._reference_of(joint)),
                (pdos.measured[joint], _store_pair(self._reported, joint, 0)),
                (pdos.command[joint], _store_pair(self._reported, joint, 2)),
                (pdos.internals[joint][0], _store_pair(self._internals, joint, 0)),
                (pdos.internals[joint][1], _store_pair(self._internals, joint, 2)),
            )
            handlers |= {layout.cob_id: (layout, handler) for layout, handler in parts}
        return handlers

    @property
    def changes(self) -> tuple[int, int, tuple[int, int, int] | None]:
        """Is another one as soon as a cycle, a reference or a report of the controller has come."""
        return self._samples.changes, self._references.changes, self._report

    def receive(self, frames: Iterable[tuple[int, Frame]], wall_ns: int) -> None:
        """Take (bus time in ns, frame) as a port gives them, at the wall time `wall_ns`."""
        self._wall_ns = wall_ns
        handlers = self._handlers
        for bus_ns, (can_id, data, is_extended, is_remote) in frames:
            self._received += 1
            known = handlers.get(can_id)
            if known is None or is_extended or is_remote:
                if is_extended or can_id not in self._not_ours:
                    self._unknown += 1
                continue
            layout, handle = known
            if len(data) < layout.size:
                self._malformed += 1
                continue
            self._bus_ns = bus_ns
            handle(*layout.unpack(data[: layout.size]))
        self._mark(wall_ns)

    def reconnected(self) -> None:
        """The bus was lost and is back: frames of the gap do not count as dropped, nor towards rates."""
        self._cycle = self.faults = None
        self._previous_ticks = [None] * len(self._previous_ticks)
        self._marks.clear()

    def snapshot(self, wall_ns: int) -> Snapshot:
        """The run as received so far, at the wall time `wall_ns`."""
        cycles, values, references, error_lsb = self._window_now()
        reported, internals = self._reported.copy(), self._internals.copy()
        for array in (reported, internals):
            array.flags.writeable = False
        report = self._report
        return Snapshot(
            joints=tuple(
                self._joint(joint, cycles, values, references, error_lsb) for joint in range(len(self._lsb_rad))
            ),
            age_ns=None if self._telemetry_wall_ns is None else wall_ns - self._telemetry_wall_ns,
            cycle=int(cycles[-1]) if len(cycles) else None,
            rates=self._rates(wall_ns),
            report=None if report is None else Report(*report, age_ns=wall_ns - self._report_wall_ns),
            counters=Counters(
                self._received, self._unknown, self._malformed, self._dropped_samples, self._dropped_references
            ),
            faults=self.faults,
            cycles=cycles,
            error_lsb=error_lsb,
            window_cycles=self._window,
            reported=reported,
            internals=internals,
        )

    def _window_now(self) -> _Window:
        """The window as it is; the same arrays as long as nothing has come, so that nobody draws them again."""
        changes = self.changes[:2]
        if self._drawn is None or self._drawn[0] != changes:
            cycles, values = self._samples.since(0 if self._sample is None else self._sample[0] - self._window)
            references = self._references.at(cycles)
            with np.errstate(invalid="ignore", over="ignore"):
                error_lsb = (values[:, :, _ANGLE] - references) / self._lsb_rad
            error_lsb[~np.isfinite(error_lsb)] = np.nan
            for array in (cycles, error_lsb):
                array.flags.writeable = False
            self._drawn = changes, _Window(cycles, values, references, error_lsb)
        return self._drawn[1]

    def _joint(
        self,
        joint: int,
        cycles: NDArray[np.int64],
        values: NDArray[np.float64],
        references: NDArray[np.float64],
        error_lsb: NDArray[np.float64],
    ) -> JointNow:
        if not len(cycles):
            return JointNow()
        errors = error_lsb[:, joint]
        matched = np.flatnonzero(np.isfinite(errors))
        row = len(cycles) - 1
        if len(matched) and cycles[-1] - cycles[matched[-1]] <= self._match:
            row = int(matched[-1])
        finite = errors[matched]
        now, reference_rad, error = values[row, joint], references[row, joint], errors[row]
        if self._idle is not None:
            now, reference_rad, error = self._idle[joint], np.nan, np.nan
        angle, speed, current, command = now.tolist()
        return JointNow(
            angle_rad=angle,
            speed_rad_s=speed,
            reference_rad=float(reference_rad),
            error_lsb=float(error),
            rms_lsb=float(np.sqrt(np.mean(finite * finite))) if len(finite) else np.nan,
            max_lsb=float(np.max(np.abs(finite))) if len(finite) else np.nan,
            current_a=current,
            command_a=command,
            saturation=int(np.sign(command)) if abs(command) >= self._limit_a[joint] else 0,
        )

    def _on_status(self, cycle: int) -> None:
        previous = self._cycle
        if previous is not None:
            if self._row_parts != self._all_parts:
                self._dropped_samples += 1
            self._dropped_samples += max(0, (cycle - 1) // DIVIDER - previous // DIVIDER)
        if self._sample is not None and cycle < self._sample[0]:
            self._begin_run(cycle)
        self._telemetry_wall_ns = self._wall_ns
        self._cycle, self._cycle_ns, self._row_parts = cycle, self._bus_ns, 0

    def _begin_run(self, cycle: int) -> None:
        self._samples.clear()
        self._marks.clear()
        self._sample = self._idle = None
        for joint, tick in enumerate(self._references.last_ticks):
            # The new run's first references may arrive shortly before its first telemetry.
            if tick > cycle + self._match:
                self._references.clear(joint)

    def _part(self, bit: int, place: int) -> Callable[..., None]:
        row = self._row

        def store(first: float, second: float) -> None:
            if self._cycle is None:
                return
            row[place], row[place + 1] = first, second
            self._row_parts |= bit
            if self._row_parts == self._all_parts:
                self._take_row(self._cycle)

        return store

    def _take_row(self, cycle: int) -> None:
        if self._sample is None or self._sample[0] != cycle:
            self._samples.append(cycle, self._row)
            self._sample, self._idle = (cycle, self._cycle_ns), None
        else:
            # The bench sends without a SYNC: the robot may move, and no reference belongs to that.
            self._idle = np.array(self._row).reshape(-1, FIELDS)

    def _reference_of(self, joint: int) -> Callable[..., None]:
        ring = self._references

        def store(tick: int, angle_rad: float) -> None:
            previous = self._previous_ticks[joint]
            if previous is not None and tick > previous + 1:
                self._dropped_references += tick - previous - 1
            if tick < ring.last_ticks[joint]:
                ring.clear(joint)
            ring.put(joint, tick, angle_rad)
            self._previous_ticks[joint] = tick

        return store

    def _on_controller(self, tick: int, late: int, state: int) -> None:
        self._report = tick, late, state
        self._report_wall_ns = self._wall_ns

    def _on_faults(self, active: int, stop: int, begun: int, detections: int) -> None:
        self.faults = FaultSignal(active, bool(stop), begun, detections)

    def _mark(self, wall_ns: int) -> None:
        marks = self._marks
        if self._sample is not None and self._cycle is not None and (not marks or marks[-1].cycle != self._sample[0]):
            marks.append(_Mark(wall_ns, self._sample[1], self._sample[0]))
        while marks and marks[0].wall_ns < wall_ns - RATE_WINDOW_NS:
            marks.popleft()

    def _rates(self, wall_ns: int) -> Rates | None:
        marks = [mark for mark in self._marks if mark.wall_ns >= wall_ns - RATE_WINDOW_NS]
        if len(marks) < 2:
            return None
        first, last = marks[0], marks[-1]
        wall_s, bus_s = 1e-9 * (last.wall_ns - first.wall_ns), 1e-9 * (last.bus_ns - first.bus_ns)
        if wall_s <= 0.0:
            return None
        count = last.cycle - first.cycle
        per_wall_s = count / wall_s
        return Rates(count / bus_s if bus_s > 0.0 else np.nan, per_wall_s, per_wall_s * self._cycle_s)


def _store_pair(array: NDArray[np.float64], joint: int, place: int) -> Callable[..., None]:
    row = array[joint]

    def store(first: float, second: float) -> None:
        row[place], row[place + 1] = first, second

    return store


def _other_services(cell: Cell) -> frozenset[int]:
    """COB-IDs of the bench bus that are neither shown nor unknown: NMT, heartbeats, the bench's EMCY and SDO, figures
    of the wire, detections (which are read by SDO).
    """
    node_id, pdos = cell.bus.bench_node_id, bench_pdos(cell)
    channels = [cob_id for channel in range(SDO_CHANNELS + 1) for cob_id in sdo_channel(node_id, channel)]
    heartbeats = range(Cob.HEARTBEAT + 1, Cob.HEARTBEAT + 128)
    others = (Cob.NMT, Cob.EMERGENCY + node_id, pdos.bus.cob_id, pdos.detection.cob_id)
    return frozenset([*others, *channels, *heartbeats])
