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
from canarm_protocol.cell.bench_objects import (
    CONTROLLER_STATES,
    DIVIDER,
    ENDED,
    HOMING,
    INTERNALS,
    SDO_CHANNELS,
    bench_pdos,
    sdo_channel,
)
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import position_steps_rad
from canarm_protocol.faults.run_plan import RunPlan

from .faults import FaultSignal
from .history import COLUMNS, REPORTED_COLUMNS, Column, History
from .joints_now import JointReader
from .notices import ControllerNotices
from .rings import ReferenceRing, RowStore
from .snapshot import BusNow, Counters, Rates, Report, Snapshot

WINDOW_S = 10.0
"""Traces and RMS cover this much of the run, in cycles of nominal length."""
MATCH_S = 0.5
"""A reference that lags the newest sample by more is no longer shown as current."""
KEPT_S = 120.0
"""This much of the run is kept, so that one can look back."""
LOST_NS = 1_000_000_000
LOST_CYCLES = 64
"""A controller that has the robot reports every 16 cycles. It is lost when it has been silent for `LOST_NS`, in which
cycles stood still (at a slow pace they do not) or went on without it."""
STOPPING_S = 2.5
"""In a safe stop a controller is silent for up to 2 s of the run, while cycles go on."""
HAVING = ("homing", "running", "stopping")
"""States of a controller that has the robot."""
RUNNING = ("homing", "running")
RATE_WINDOW_NS = 2_000_000_000


class _Mark(NamedTuple):
    """A sample's time on three clocks."""

    wall_ns: int
    bus_ns: int
    cycle: int


class Feed:
    """The state of the dashboard's data. A cycle or tick that goes backwards begins a new run."""

    def __init__(self, cell: Cell) -> None:
        joints = len(cell.joints)
        self._cycle_s = cell.bus.cycle_s
        self._stopping_cycles = max(LOST_CYCLES, round(STOPPING_S / cell.bus.cycle_s))
        self._is_lost = False
        self._window = max(1, round(WINDOW_S / cell.bus.cycle_s))
        self._match = max(1, round(MATCH_S / cell.bus.cycle_s))
        self._lsb_rad = np.array(position_steps_rad(cell))
        self._reader = JointReader(cell, self._match)
        self._rows = RowStore(max(1, round(KEPT_S / cell.bus.cycle_s / DIVIDER)), joints)
        self._references = ReferenceRing(2 * self._window, joints)
        self._row = np.full((joints, COLUMNS), np.nan, dtype=np.float32)
        self._row_parts = 0
        self._all_parts = (1 << 2 * joints) - 1
        self._wall_ns = self._bus_ns = 0
        self._cycle: int | None = None
        self._cycle_ns = 0
        self._sample: tuple[int, int] | None = None
        self._idle: NDArray[np.float32] | None = None
        self._telemetry_wall_ns: int | None = None
        self._moved_wall_ns = 0
        self._previous_ticks: list[int | None] = [None] * joints
        self._marks: deque[_Mark] = deque()
        self._drawn: tuple[tuple[int, int], History, NDArray[np.float64]] | None = None
        self._bus: BusNow | None = None
        self._report: tuple[int, int, int] | None = None
        self._report_wall_ns = 0
        self.notices = ControllerNotices()
        """What the controller has said of itself, as events."""
        self.controllers = 0
        """How many have reported so far, one after the other."""
        self.faults: FaultSignal | None = None
        """The bench's latest report of its faults since the bus was opened."""
        self.law = ""
        """The controller's law, and what it calls its own values, as the bench has been told; set from outside."""
        self.internal_names: tuple[str, ...] = ()
        self.plan: RunPlan | None = None
        """Clock, length and pace of the run, as the bench has been told; set from outside."""
        self._begin_tick = 0
        self._received = self._unknown = self._malformed = 0
        self._dropped_samples = self._dropped_references = 0
        self._reported = np.full((joints, REPORTED_COLUMNS), np.nan)
        self._handlers = self._make_handlers(cell)
        self._not_ours = _other_services(cell)

    def _make_handlers(self, cell: Cell) -> dict[int, tuple[PdoLayout, Callable[..., None]]]:
        pdos = bench_pdos(cell)
        handlers: dict[int, tuple[PdoLayout, Callable[..., None]]] = {
            pdos.status.cob_id: (pdos.status, self._on_status),
            pdos.controller.cob_id: (pdos.controller, self._on_controller),
            pdos.faults.cob_id: (pdos.faults, self._on_faults),
            pdos.bus.cob_id: (pdos.bus, self._on_bus),
        }
        for joint in range(len(cell.joints)):
            parts = (
                (pdos.truth[joint], self._part(1 << 2 * joint, joint, Column.ANGLE)),
                (pdos.drive[joint], self._part(2 << 2 * joint, joint, Column.CURRENT)),
                (pdos.reference[joint], self._reference_of(joint)),
                (pdos.measured[joint], self._report_of(joint, 0)),
                (pdos.command[joint], self._report_of(joint, 2)),
                (pdos.internals[joint][0], self._report_of(joint, 4)),
                (pdos.internals[joint][1], self._report_of(joint, 6)),
            )
            handlers |= {layout.cob_id: (layout, handler) for layout, handler in parts}
        return handlers

    @property
    def is_running(self) -> bool:
        """Whether the controller has said last, and lately, that it controls the robot."""
        if self._report is None or self._is_silent(self._wall_ns):
            return False
        return CONTROLLER_STATES.get(self._report[2]) in RUNNING

    @property
    def has_ended(self) -> bool:
        """Whether the controller has said last that its run has ended."""
        return self._report is not None and CONTROLLER_STATES.get(self._report[2]) in ENDED

    @property
    def cycle(self) -> int | None:
        """The last cycle that the bench has told; None before, and where the bus was lost."""
        return self._cycle

    @property
    def changes(self) -> tuple[int, int, tuple[int, int, int] | None]:
        """Is another one as soon as a cycle, a reference or a report of the controller has come."""
        return self._rows.changes, self._references.changes, self._report

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
        self._watch_controller(wall_ns)

    def _watch_controller(self, wall_ns: int) -> None:
        """It is lost if the bench went on without it; that it was stays, whatever becomes of the bench."""
        is_silent = self._is_silent(wall_ns)
        if self._report is None or not is_silent:
            self._is_lost = False
        elif not self._is_lost and (self._telemetry_wall_ns or 0) - self._report_wall_ns > LOST_NS:
            self._is_lost = True
            self.notices.lost(self._report[0], self._bus_ns, self._cycle or 0)

    def lives(self, wall_ns: int) -> bool:
        """Whether the bench has sent something lately."""
        return self._telemetry_wall_ns is not None and wall_ns - self._telemetry_wall_ns <= LOST_NS

    def reconnected(self) -> None:
        """The bus was lost and is back, perhaps with another bench, whose controller has to report first: frames of the
        gap do not count as dropped, nor towards rates.
        """
        self._cycle = self.faults = self._report = None
        self.law, self.internal_names, self.plan = "", (), None
        self._previous_ticks = [None] * len(self._previous_ticks)
        self._marks.clear()

    def snapshot(self, wall_ns: int) -> Snapshot:
        """The run as received so far, at the wall time `wall_ns`."""
        window, error_lsb = self._window_now()
        reported = self._reported.copy()
        reported.flags.writeable = False
        cycles = window.cycles
        return Snapshot(
            joints=self._reader.read(window, error_lsb, self._idle),
            age_ns=None if self._telemetry_wall_ns is None else wall_ns - self._telemetry_wall_ns,
            cycle=int(cycles[-1]) if len(cycles) else None,
            rates=self._rates(wall_ns),
            report=self.report(wall_ns),
            counters=Counters(
                self._received, self._unknown, self._malformed, self._dropped_samples, self._dropped_references
            ),
            faults=self.faults,
            cycles=cycles,
            error_lsb=error_lsb,
            window_cycles=self._window,
            reported=reported[:, :-INTERNALS],
            internals=reported[:, -INTERNALS:],
            history=self._rows.history(),
            bus=self._bus,
            law=self.law,
            internal_names=self.internal_names,
            plan=self.plan,
            run_ticks=None if self._report is None else max(0, self._report[0] - self._begin_tick),
        )

    def _window_now(self) -> tuple[History, NDArray[np.float64]]:
        """The window as it is, and its errors (n, joints); the same arrays as long as nothing has come, so that nobody
        draws them again.
        """
        changes = self.changes[:2]
        if self._drawn is None or self._drawn[0] != changes:
            self._rows.fill_references(self._references, self._window, self._lsb_rad)
            last = 0 if self._sample is None else self._sample[0]
            window = self._rows.history().between(last - self._window, last)
            error_lsb = window.values[:, :, Column.ERROR].astype(np.float64)
            error_lsb.flags.writeable = False
            self._drawn = changes, window, error_lsb
        return self._drawn[1:]

    def _on_status(self, cycle: int) -> None:
        previous = self._cycle
        if previous is not None:
            if self._row_parts != self._all_parts:
                self._dropped_samples += 1
            self._dropped_samples += max(0, (cycle - 1) // DIVIDER - previous // DIVIDER)
        if self._sample is not None and cycle < self._sample[0]:
            self._begin_run(cycle)
        self._telemetry_wall_ns = self._wall_ns
        if cycle != previous:
            self._moved_wall_ns = self._wall_ns
        self._cycle, self._cycle_ns, self._row_parts = cycle, self._bus_ns, 0

    def report(self, wall_ns: int) -> Report | None:
        """What the controller has said of itself last, at the wall time `wall_ns`."""
        if self._report is None:
            return None
        return Report(*self._report, wall_ns - self._report_wall_ns, self._is_lost and self._is_silent(wall_ns))

    def _is_silent(self, wall_ns: int) -> bool:
        """Whether a controller that had the robot last reports no more."""
        if self._report is None:
            return False
        tick, _, state = self._report
        name = CONTROLLER_STATES.get(state)
        age_ns, still_ns = wall_ns - self._report_wall_ns, wall_ns - self._moved_wall_ns
        without = self._stopping_cycles if name == "stopping" else LOST_CYCLES
        went_on = (self._cycle or 0) - tick > without
        return name in HAVING and age_ns > LOST_NS and (still_ns > LOST_NS or went_on)

    def _begin_run(self, cycle: int) -> None:
        if self._is_silent(self._wall_ns):
            self._report = None
        self._rows.clear()
        self._marks.clear()
        self._sample = self._idle = None
        for joint, tick in enumerate(self._references.last_ticks):
            # The new run's first references may arrive shortly before its first telemetry.
            if tick > cycle + self._match:
                self._references.clear(joint)

    def _part(self, bit: int, joint: int, place: int) -> Callable[..., None]:
        row = self._row[joint]

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
            self._rows.append(cycle, self._row)
            self._sample, self._idle = (cycle, self._cycle_ns), None
        else:
            # The bench sends without a SYNC: the robot may move, and no reference belongs to that.
            self._idle = self._row.copy()

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

    def _report_of(self, joint: int, place: int) -> Callable[..., None]:
        row, rows, ticks = self._reported[joint], self._rows, self._references.last_ticks

        def store(first: float, second: float) -> None:
            row[place], row[place + 1] = first, second
            # They have no tick of their own: a controller sends them after the references of their tick.
            rows.put(ticks[joint], joint, Column.MEASURED + place, (first, second))

        return store

    def _on_bus(self, load: float, error_frames: int) -> None:
        self._bus = BusNow(load, error_frames)

    def _on_controller(self, tick: int, late: int, state: int) -> None:
        before = self._report
        if before is None or tick < before[0] or self._is_silent(self._wall_ns):
            self.controllers += 1
            self._begin_tick = 0
        elif before[2] == HOMING and state != HOMING:
            self._begin_tick = tick
        self._report = tick, late, state
        self._report_wall_ns = self._wall_ns
        self.notices.take(tick, late, state, self._bus_ns)

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


def _other_services(cell: Cell) -> frozenset[int]:
    """COB-IDs of the bench bus that are neither shown nor unknown: NMT, heartbeats, the bench's EMCY and SDO,
    detections (which are read by SDO).
    """
    node_id, pdos = cell.bus.bench_node_id, bench_pdos(cell)
    channels = [cob_id for channel in range(SDO_CHANNELS + 1) for cob_id in sdo_channel(node_id, channel)]
    heartbeats = range(Cob.HEARTBEAT + 1, Cob.HEARTBEAT + 128)
    others = (Cob.NMT, Cob.EMERGENCY + node_id, pdos.detection.cob_id)
    return frozenset([*others, *channels, *heartbeats])
