"""A client of a bench node on the bench bus: faults and the emergency stop of a running bench, over any kind of bus.

It claims an SDO channel of its own, so that several clients work at the same time. The bench judges a fault set; this
passes on the reason of a refusal.
"""

import contextlib
import secrets
import struct
import time
from collections.abc import Callable
from numbers import Real
from types import TracebackType
from typing import Any, Self, TypeVar

from ..canopen.dictionary import CLOCK_MODE
from ..canopen.frames import Frame
from ..canopen.sdo import AbortCode, SdoAborted, download, upload
from ..cell import bench_objects as objects
from ..cell.model import Cell
from ..clock import Clock
from ..errors import BusError, FaultError, UsageError
from ..shown import printable_lines, quoted
from ..transport.port import BusPort
from ..transport.sdo_session import SdoSession
from .bench_answers import P, plain_of, unpacked
from .fault_toml import as_toml
from .run_plan import RunPlan
from .script import LARGEST_TEXT, FaultScript, clearing
from .wire_figures import WireFigures, wire_figures

RENEW_S = objects.CLAIM_S / 2
"""After this long without use the channel is claimed again first: another client may soon take it."""
MOST_READS = 1000
"""Bound on draining what has arrived: a bus with telemetry never falls silent."""
_REFUSED = "refused: "
_TOKEN = struct.Struct("<I")

T = TypeVar("T")


class BenchClient:
    """Faults of the bench of `cell` on the open bus `port`, which stays the caller's.

    Use it in a `with` statement or `close` it, which gives its channel back. It waits at most `limit_s` for an answer.
    Every method raises `BusError` when the bus is lost or the bench node does not answer; for what is no port or no
    cell it is `UsageError`.
    """

    def __init__(self, port: BusPort, cell: Cell, limit_s: float = 5.0) -> None:
        _check("port", port, hasattr(port, "send") and hasattr(port, "receive"), "an open bus (open_port)")
        _check("cell", cell, isinstance(cell, Cell), "a cell (load_cell)")
        _check("limit_s", limit_s, isinstance(limit_s, Real), "a number of seconds")
        self._port, self._node_id, self._limit_s = port, cell.bus.bench_node_id, limit_s
        self._token = 1 + secrets.randbelow(0xFFFF_FFFF)
        self._used_s = time.monotonic()
        self.channel = self._claim(objects.CLIENT_CHANNELS[self._token % len(objects.CLIENT_CHANNELS)])
        """The number of its SDO channel."""

    def inject(self, text: str | bytes) -> str:
        """Send the fault set `text` (TOML), which is carried out as a whole or refused; returns what was done.

        Bytes are text in UTF-8. Raises `FaultError` if it is refused.
        """
        if isinstance(text, bytes):
            try:
                text = text.decode()
            except UnicodeDecodeError as error:
                raise FaultError(f"fault set: is no text in UTF-8, from byte {error.start} on") from None
        if len(text) > LARGEST_TEXT:
            raise FaultError(f"fault set: {len(text)} characters; must have at most {LARGEST_TEXT}")
        try:
            data = text.encode()
        except UnicodeEncodeError as error:
            raise FaultError(f"fault set: {text[error.start : error.end]!r} is no text, and cannot be sent") from None

        def write(session: SdoSession) -> str:
            try:
                session.download(objects.FAULT_SET, 0, data)
            except SdoAborted:
                result = _text(session.upload(objects.FAULT_RESULT))
                if result.startswith(_REFUSED):
                    raise FaultError(result.removeprefix(_REFUSED)) from None
                raise
            return _text(session.upload(objects.FAULT_RESULT))

        return self._ask(write)

    def clear(self, name: str | None = None) -> str:
        """End and forget the sets of that name, or all; returns what was done. Raises `FaultError` if there is none."""
        return self.inject(as_toml(clearing(name)))

    def trigger(self, name: str) -> str:
        """Begin a set that waits; returns what was done. Raises `FaultError` where there is none."""
        return self.inject(as_toml(FaultScript(trigger=name)))

    def status(self) -> dict[str, Any]:
        """`sets` (set, state, activations), `active` (set, tap, fault), `begun`, `time_ns`, `cycle` and `running`."""
        return dict(self._plain(self._read(objects.FAULT_STATUS), dict))

    def catalogue(self) -> list[dict[str, Any]]:
        """One object per tap: tap, about, unit, kind, and faults with their parameters."""
        return list(self._plain(self._unpacked(objects.PACKED_CATALOGUE), list))

    def events(self) -> list[dict[str, Any]]:
        """The last beginnings and ends of faults, oldest first, as in `events.jsonl`."""
        return self._lines(objects.PACKED_EVENTS)

    def detections(self) -> list[dict[str, Any]]:
        """The last detections of controllers, oldest first: cycle, detector, where, detail, reaction."""
        return self._lines(objects.PACKED_DETECTIONS)

    def law(self) -> tuple[str, tuple[str, ...]]:
        """What the controller's law and its own values are called; empty where nobody has said so."""

        def read(session: SdoSession) -> tuple[str, tuple[str, ...]]:
            names = (session.upload(objects.INTERNAL_NAME, place + 1) for place in range(objects.INTERNALS))
            return _text(session.upload(objects.LAW_NAME)), tuple(map(_text, names))

        return self._ask(read)

    def plan(self) -> RunPlan:
        """Clock, length and pace of the run, as the bench and its controller say."""

        def read(session: SdoSession) -> RunPlan:
            clock = int.from_bytes(session.upload(CLOCK_MODE), "little")
            ticks = int.from_bytes(session.upload(objects.RUN_TICKS), "little")
            pace = session.upload(objects.PACE)
            found = struct.unpack("<f", pace)[0] if len(pace) == 4 else 0.0
            return RunPlan(clock == Clock.SYNC.value, ticks, found if found > 0.0 else None)

        return self._ask(read)

    def outcome(self) -> str:
        """How the controller says its run has ended: a verdict, and a line for each detail; "" before."""
        return printable_lines(self._read(objects.OUTCOME).decode("utf-8", "replace").strip())

    def recording(self) -> tuple[bool, str]:
        """Whether frames and signals are recorded, and in which folder, or why they are not."""

        def read(session: SdoSession) -> tuple[bool, str]:
            return session.upload(objects.RECORDING) != b"\0", _text(session.upload(objects.RECORD_PLACE))

        return self._ask(read)

    def record(self, is_on: bool) -> str:
        """Record frames and signals from now on, or no longer; returns the folder. Raises `FaultError` with the reason
        where nothing can be recorded.
        """

        def write(session: SdoSession) -> str:
            try:
                session.download(objects.RECORDING, 0, bytes((is_on,)))
            except SdoAborted as error:
                if error.code != AbortCode.DEVICE_STATE:
                    raise
                raise FaultError(_text(session.upload(objects.RECORD_PLACE))) from None
            return _text(session.upload(objects.RECORD_PLACE))

        return self._ask(write)

    def wire_figures(self, cell: Cell) -> WireFigures:
        """Load, errors and clients of the buses; `cell` is the bench's."""
        return self._ask(lambda session: self._sense(lambda: wire_figures(session.upload, cell)))

    @property
    def is_stopped(self) -> bool:
        """Whether the emergency stop is on."""
        return self._read(objects.EMERGENCY_STOP) != b"\0"

    def emergency_stop(self, is_on: bool = True) -> None:
        """Open the supply of all amplifiers, or close it again."""
        self._ask(lambda session: session.download(objects.EMERGENCY_STOP, 0, bytes((is_on,))))

    def power_cycle(self) -> None:
        """Switch the robot off and on again: faults and emergency stop gone, arms parked, every card boots."""
        self._ask(lambda session: session.download(objects.POWER_CYCLE, 0, b"\1"))

    def close(self) -> None:
        """Give the channel back. May be called again."""
        channel, self.channel = self.channel, 0
        if channel:
            with contextlib.suppress(BusError, SdoAborted):
                self._session(channel).download(objects.CHANNEL_OWNER, channel, _TOKEN.pack(0))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _read(self, index: int) -> bytes:
        return self._ask(lambda session: session.upload(index))

    def _plain(self, data: bytes, kind: type[P]) -> P:
        return self._sense(lambda: plain_of(data, kind))

    def _unpacked(self, index: int) -> bytes:
        data = self._read(index)
        return self._sense(lambda: unpacked(data))

    def _lines(self, index: int) -> list[dict[str, Any]]:
        return [dict(self._plain(line, dict)) for line in self._unpacked(index).splitlines() if line]

    def _sense(self, read: Callable[[], T]) -> T:
        """The result of `read`; its `ValueError` becomes a `BusError`."""
        try:
            return read()
        except ValueError as error:
            raise BusError(f"{self._where}: {error}; is it a bench of this project?") from None

    def _ask(self, conversation: Callable[[SdoSession], T]) -> T:
        """Talk to the node on our channel, claimed again if need be. Raises `BusError`."""
        if not self.channel:
            raise BusError(f"{self._where}: this client is closed")
        if time.monotonic() - self._used_s > RENEW_S:
            self.channel = self._claim(self.channel)
        self._drain()
        try:
            return conversation(self._session(self.channel))
        except (BusError, SdoAborted) as error:
            raise BusError(f"{self._where}: {error}") from None
        finally:
            self._used_s = time.monotonic()

    def _session(self, channel: int) -> SdoSession:
        return SdoSession(self._port, *objects.sdo_channel(self._node_id, channel), limit_s=self._limit_s)

    @property
    def _where(self) -> str:
        return f"bench node 0x{self._node_id:02X}"

    def _claim(self, first: int) -> int:
        """A channel of our own, `first` if it can be had."""
        channels = objects.CLIENT_CHANNELS
        self._drain()
        for channel in sorted(channels, key=lambda each: (each - first) % len(channels)):
            if self._ask_owner(channel) == self._token:
                self._used_s = time.monotonic()
                return channel
        raise BusError(
            f"{self._where} on {self._port.description}: all {len(channels)} channels for clients are taken; "
            f"end one of them, or wait {objects.CLAIM_S:g} s"
        )

    def _ask_owner(self, channel: int) -> int:
        """Claim `channel` and ask for its owner. Answers to other clients on the claim channel are just as true: they
        name the object that they are about.
        """
        request_id, answer_id = objects.sdo_channel(self._node_id, objects.CLAIM_CHANNEL)
        reading = upload(objects.CHANNEL_OWNER, channel)
        claim = next(download(objects.CHANNEL_OWNER, channel, _TOKEN.pack(self._token)))
        self._port.send([Frame(request_id, claim), Frame(request_id, next(reading))])
        expected = struct.pack("<BHB", 0x43, objects.CHANNEL_OWNER, channel)
        deadline_s = time.monotonic() + self._limit_s
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            for _, frame in self._port.receive(left_s):
                if frame.can_id == answer_id and not frame.is_extended and frame.data.startswith(expected):
                    return int(_TOKEN.unpack_from(frame.data, 4)[0])
        raise BusError(
            f"{self._where} on {self._port.description} has not answered within {self._limit_s:g} s; does an emulator "
            "serve this bus, and this cell?"
        )

    def _drain(self) -> None:
        for _ in range(MOST_READS):
            if not self._port.receive(0.0):
                break


def _check(what: str, value: object, is_right: bool, right: str) -> None:
    if not is_right:
        raise UsageError(f"BenchClient: {what} {quoted(value)}: must be {right}")


def _text(data: bytes) -> str:
    return printable_lines(data.decode("ascii", "replace"))
