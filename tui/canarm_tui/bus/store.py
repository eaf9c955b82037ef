"""Frames of a bus in, pictures out. All memory is bounded: rows by identifier, the last frames, nodes 1 to 127.

Sans-IO: wall time is passed in with every call, bus time comes with every frame. Nothing is decoded here but what has
to be followed frame by frame.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.decoding import Decoder
from canarm_protocol.decoding.sdo_texts import About
from canarm_protocol.errors import FrameError
from canarm_protocol.transport.bits import INTERMISSION_BITS, frame_bits

from .load import Load, LoadMeter
from .nodes import HeardEmergency, NodeNow, NodeTable, is_of_node
from .rows import Key, Row, RowNow

MOST_ROWS = 4096
"""All 11-bit identifiers, and as many of 29 bits; further ones are counted only."""
LOG_LENGTH = 2000
_MEASURED_EVERY = 16
"""The length on the wire is worked out for one of so many frames of a row: it costs more than all the rest."""


class Heard(NamedTuple):
    """A frame of the log: when on the bus's clock, what, and what its SDO transfer is about."""

    time_ns: int
    frame: Frame
    about: About


@dataclass(frozen=True, slots=True, eq=False)
class BusNow:
    """The bus as received so far; `version` is another one as soon as anything has come."""

    version: int
    rows: Sequence[RowNow]
    log: Sequence[Heard]
    nodes: Sequence[NodeNow]
    emergencies: Sequence[HeardEmergency]
    """The last ones, newest first."""
    load: Load
    received: int
    untracked: int
    """Frames of identifiers beyond `MOST_ROWS`."""
    errors: int
    """Error frames among those received."""
    wall_ns: int
    """When the last frame was heard."""


class BusStore:
    """The memory of a bus. `bitrate` is in bit/s, None if it is not known: then there is no load."""

    def __init__(self, decoder: Decoder, bitrate: int | None) -> None:
        self.decoder = decoder
        self.version = 0
        self._rows: dict[Key, Row] = {}
        self._log: deque[Heard] = deque(maxlen=LOG_LENGTH)
        self._nodes = NodeTable(decoder.book)
        self.meter = LoadMeter(bitrate)
        self._received = self._untracked = self._errors = 0
        self._bits = 0
        self._wall_ns = 0

    def receive(self, frames: Sequence[tuple[int, Frame]], wall_ns: int) -> None:
        """Take (bus time in ns, frame) as a port gives them, at the wall time `wall_ns`."""
        if not frames:
            return
        rows, log = self._rows, self._log
        for time_ns, frame in frames:
            can_id, data, is_extended, is_remote = frame
            key = (can_id, is_extended, is_remote)
            row = rows.get(key)
            if row is None:
                row = self._new_row(key, frame, time_ns)
                if row is None:
                    continue
            elif row.frame[1] != data:
                row.differs(data, wall_ns)
            count = row.count
            if not count % _MEASURED_EVERY or len(row.frame[1]) != len(data):
                row.bits = _length(frame)
            self._bits += row.bits
            row.count = count + 1
            row.before_ns, row.time_ns, row.wall_ns = row.time_ns, time_ns, wall_ns
            row.frame = frame
            if row.is_followed:
                row.about = self._follow(frame, wall_ns)
            log.append(Heard(time_ns, frame, row.about))
        bus_ns = frames[-1][0]
        for row in rows.values():
            row.close_interval(bus_ns)
        self._received += len(frames)
        self.version += 1
        self._wall_ns = wall_ns
        self.meter.note(bus_ns, wall_ns, self._bits, self._received)

    def reconnected(self) -> None:
        """The bus was lost and is back: the gap counts in no rate."""
        self.meter.forget()

    def clear(self) -> None:
        """Begin anew: counters, rows, log; nodes stay known."""
        self._rows.clear()
        self._log.clear()
        self.meter.forget()
        self._received = self._untracked = self._errors = self._bits = 0
        self.version += 1

    def now(self, wall_ns: int) -> BusNow:
        """The bus at the wall time `wall_ns`."""
        return BusNow(
            version=self.version,
            rows=[row.now() for row in self._rows.values()],
            log=list(self._log),
            nodes=self._nodes.now(),
            emergencies=list(reversed(self._nodes.emergencies)),
            load=self.meter.load(wall_ns),
            received=self._received,
            untracked=self._untracked,
            errors=self._errors,
            wall_ns=self._wall_ns,
        )

    def row(self, key: Key) -> RowNow | None:
        """One row as it is."""
        row = self._rows.get(key)
        return None if row is None else row.now()

    def _new_row(self, key: Key, frame: Frame, time_ns: int) -> Row | None:
        if len(self._rows) >= MOST_ROWS:
            self._untracked += 1
            return None
        row = self._rows[key] = Row(key, frame, time_ns)
        row.is_followed = frame.is_error or self.decoder.book.channel(key[0]) is not None or is_of_node(frame)
        return row

    def _follow(self, frame: Frame, wall_ns: int) -> About:
        if frame.is_error:
            self._errors += 1
        about = self.decoder.follow(frame)
        self._nodes.take(frame, wall_ns)
        return about


def _length(frame: Frame) -> int:
    """Bits on the wire with the pause behind them; none for what is no frame of classical CAN."""
    try:
        return frame_bits(frame) + INTERMISSION_BITS
    except FrameError:
        return 0
