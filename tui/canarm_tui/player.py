"""A recorded run that plays: it gives the snapshots that a live run would, at a place that moves, jumps or stands.

Wall time is passed in with every call. Nothing is drawn here, and no file is read.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager

import numpy as np

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.bench_objects import DIVIDER
from canarm_protocol.errors import BusError
from canarm_protocol.faults.run_plan import RunPlan
from canarm_protocol.transport.port import BusPort

from .fault_desk import FaultDesk
from .faults import ActingFault, Faults, FaultSignal
from .feed import MATCH_S, WINDOW_S
from .history import Column
from .joints_now import JointReader
from .link import LinkState
from .notices import Notice
from .outcome import Outcome
from .record import Record
from .snapshot import Snapshot

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0)
SEEK_S = 5.0
NOBODY = "this is a recorded run: nothing can be injected into it, cleared, stopped, reset or driven"


class Player:
    """Plays `record` from its beginning."""

    def __init__(self, record: Record) -> None:
        cell = record.cell
        self._record, self._cycle_s = record, cell.bus.cycle_s
        self._window = max(1, round(WINDOW_S / self._cycle_s))
        self._reader = JointReader(cell, max(1, round(MATCH_S / self._cycle_s)))
        cycles = record.history.cycles
        self._first, self._last = (int(cycles[0]), int(cycles[-1])) if len(cycles) else (0, 0)
        self._at = float(self._first)
        self._wall_ns: int | None = None
        self._drawn: tuple[object, Snapshot] | None = None
        self.is_playing = True
        self.speed = 1.0
        self.law, self.internal_names = record.law, record.internal_names
        self.plan: RunPlan | None = None
        self.is_running = self.has_ended = False
        """It has no controller that could be asked."""
        self.controllers = 0
        self.faults: FaultSignal | None = None
        self.notices = _Played(self, record.noticed)
        events = record.faults.events + record.faults.detections + record.faults.stops
        moments = [event.cycle for event in (*events, *record.noticed)]
        self._moments = sorted({min(cycle, self._last) for cycle in moments if cycle >= self._first})

    @property
    def cycle(self) -> int:
        """Where it is."""
        return int(self._at)

    @property
    def is_at_end(self) -> bool:
        """Whether all of it has been played."""
        return self.cycle >= self._last

    @property
    def changes(self) -> object:
        """Is another one as soon as there is something else to draw."""
        return self.cycle, self.is_playing, self.speed, self.faults

    def outcome(self) -> Outcome | None:
        """How the run ended, at its end."""
        return self._record.outcome if self.is_at_end else None

    def receive(self, frames: Iterable[tuple[int, Frame]], wall_ns: int) -> None:
        """Go on, as far as the wall clock has."""
        passed_s = 0.0 if self._wall_ns is None else (wall_ns - self._wall_ns) * 1e-9
        self._wall_ns = wall_ns
        if self.is_playing:
            self._at = min(self._at + passed_s * self.speed / self._cycle_s, float(self._last))

    def reconnected(self) -> None:
        """There is no bus."""

    def toggle(self) -> None:
        """Stand still, or go on; from the end, play it again."""
        if self.is_at_end and self._last > self._first:
            self._at, self.is_playing = float(self._first), True
        else:
            self.is_playing = not self.is_playing

    def seek(self, cycle: int) -> None:
        """Go to a cycle, as far as there is one."""
        self._at = float(min(max(cycle, self._first), self._last))

    def skip(self, steps: int) -> None:
        """Some seconds on, or back."""
        self.seek(self.cycle + round(steps * SEEK_S / self._cycle_s))

    def faster(self, steps: int) -> None:
        """Another speed."""
        self.speed = SPEEDS[min(max(SPEEDS.index(self.speed) + steps, 0), len(SPEEDS) - 1)]

    def next_event(self, is_back: bool) -> bool:
        """Go to the next event, or the one before; False if there is none."""
        if is_back:
            place = bisect_left(self._moments, self.cycle) - 1
        else:
            place = bisect_right(self._moments, self.cycle)
        if not 0 <= place < len(self._moments):
            return False
        self.seek(self._moments[place])
        return True

    def faults_now(self) -> Faults:
        """The events so far, and the faults that act."""
        at, all_of_it = self.cycle, self._record.faults
        events = tuple(each for each in all_of_it.events if each.cycle <= at)
        acting: dict[tuple[str, str, str], ActingFault] = {}
        for event in reversed(events):
            key = event.set_name, event.tap, event.fault
            if event.is_begin:
                acting[key] = ActingFault(*key, event)
            else:
                acting.pop(key, None)
        detections = tuple(each for each in all_of_it.detections if each.cycle <= at)
        begun = sum(event.is_begin for event in events)
        stops = tuple(each for each in all_of_it.stops if each.cycle <= at)
        self.faults = FaultSignal(len(acting), bool(stops) and stops[0].is_on, begun, len(detections))
        return Faults(tuple(acting.values()), (), (), events, detections, stops)

    def snapshot(self, wall_ns: int) -> Snapshot:
        """The run up to where it is."""
        key = self.changes
        if self._drawn is None or self._drawn[0] != key:
            history = self._record.history.between(self._first, self.cycle)
            window = history.between(self.cycle - self._window, self.cycle)
            error_lsb = window.values[:, :, Column.ERROR].astype(np.float64)
            shown = Snapshot(
                joints=self._reader.read(window, error_lsb),
                age_ns=0,
                cycle=int(window.cycles[-1]) if len(window.cycles) else None,
                cycles=window.cycles,
                error_lsb=error_lsb,
                window_cycles=self._window,
                history=history,
                law=self.law,
                internal_names=self.internal_names,
                faults=self.faults,
                replay=self._words(),
            )
            self._drawn = key, shown
        return self._drawn[1]

    def _words(self) -> str:
        at_s, last_s = self.cycle * self._cycle_s, self._last * self._cycle_s
        sign = "▶ replay" if self.is_playing and not self.is_at_end else "⏸ replay"
        return f"{sign} {at_s:.2f} of {last_s:.2f} s, {self.speed:g} ×"


class _Played:
    """Those of the record up to where it is."""

    def __init__(self, player: Player, all_of_it: tuple[Notice, ...]) -> None:
        self._player, self._all = player, sorted(all_of_it, key=lambda notice: notice.cycle)

    @property
    def version(self) -> int:
        """How many there are."""
        if self._player.is_at_end:
            return len(self._all)
        return bisect_right(self._all, self._player.cycle, key=lambda notice: notice.cycle)

    @property
    def kept(self) -> tuple[Notice, ...]:
        """Oldest first."""
        return tuple(self._all[: self.version])


class NoLink:
    """Stands where a live run has its bus: always there, and nothing comes."""

    def __init__(self, record: Record) -> None:
        self.where, self.state = record.where, LinkState.CONNECTED
        self.reason: str | None = None
        self.connections = self.discarded = 0

    def poll(self, now_ns: int) -> list[tuple[int, Frame]]:
        """Nothing."""
        return []

    def send(self, frames: Sequence[Frame]) -> None:
        """Raises `BusError`: there is nobody to hear it."""
        raise BusError(NOBODY)

    def lend(self) -> AbstractContextManager[BusPort]:
        """Raises `BusError`: there is nobody to ask."""
        raise BusError(NOBODY)

    def reopen(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


class RecordDesk(FaultDesk):
    """Where a live run has its conversations with the bench: the faults of the record, and a refusal of all else."""

    def __init__(self, player: Player, link: NoLink, record: Record, run: Callable[[Callable[[], None]], None]) -> None:
        super().__init__(record.cell, link, run)
        self._player, self._at = player, -1

    def poll(self, signal: FaultSignal | None, now_ns: int) -> None:
        """The faults up to where the record is."""
        super().poll(None, now_ns)
        if self._at != self._player.cycle // DIVIDER:
            self._at, found = self._player.cycle // DIVIDER, self._player.faults_now()
            if found != self.faults:
                self.faults = found
