"""The run folder: which files a run leaves and how each is written, so that what was written survives a `kill -9`.

Several processes may write into one folder, each its own files, but `run.json` and `events.jsonl` are shared. Text
formats only, so that can-utils, pandas and PlotJuggler read them without this project.
"""

import contextlib
import json
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ..canopen.frames import Frame
from ..errors import ProtocolError
from ..text_file import parse_json, read_text
from .own_file import append_lines, hold_folder, locked, open_own, replace_file
from .parts import has_parts, part_of
from .tentative import Tentative

RUN_FILE, EVENTS_FILE, CAN_LOG_FILE, SIGNALS_FOLDER = "run.json", "events.jsonl", "can0.log", "signals"
BENCH_LOG_FILE = "bench.log"
"""The frames of the bench's own bus, where they are recorded."""
CONTROLLER_SIGNALS, ROBOT_SIGNALS = f"{SIGNALS_FOLDER}/controller.csv", f"{SIGNALS_FOLDER}/robot.csv"
EMULATOR_FILES = (CAN_LOG_FILE, ROBOT_SIGNALS, EVENTS_FILE, RUN_FILE)
MEMORY_FILE = "memory.bin"
CONTROLLER_FILES = (CONTROLLER_SIGNALS, MEMORY_FILE, EVENTS_FILE, RUN_FILE)
"""What each of the two writes; two files are shared."""
FLUSH_EVERY = 200
"""Lines between two flushes of a log: half a second of a run at most is lost with the process."""
SUMMARY = "summary"
"""The section that `run.json` begins with."""
TIME_WIDTH = 15
"""Characters of the time of an event: one that is not known yet is put in its place later."""
LARGEST_RUN_FILE = 16 << 20
"""Bytes; a cell with seven joints has thirty thousand."""
LOG_START_S = 1
"""Time stamp of time 0 in a candump log: can-utils' log2asc takes a start at 0 s for a missing one."""


class RunFolderError(ProtocolError):
    """A run folder cannot be written or read."""


def why_no_folder(path: Path) -> str:
    """What is wrong with a path at which there is no folder."""
    return "is no folder" if path.exists() else "there is no such folder"


def create_run_folder(path: Path, reuse: bool = False, made: Tentative | None = None) -> Path:
    """Make the folder of a run, and note it in `made`. An earlier run in it is refused unless `reuse`.

    Raises `RunFolderError`; nothing has then been made.
    """
    if not reuse and ((path / CAN_LOG_FILE).exists() or has_parts(path / CONTROLLER_SIGNALS)):
        raise _taken(path)
    for planted in (path / SIGNALS_FOLDER, path / RUN_FILE):
        if planted.is_symlink():
            raise RunFolderError(f"--out {path}: {planted} is a link; remove it, or name another folder")
    try:
        (made or Tentative()).folder(path / SIGNALS_FOLDER)
    except OSError as error:
        raise RunFolderError(f"--out {path}: cannot be made: {error.strerror}") from None
    return path


def _taken(path: Path) -> RunFolderError:
    return RunFolderError(f"--out {path}: holds a run already; name another folder, or remove it")


def claim_run_folder(path: Path, made: Tentative | None = None) -> Path:
    """Make the folder of a run for one emulator: if several try at the same time, all but one are refused.

    `made` notes it, and the files that the emulator is going to make. Raises `RunFolderError`.
    """
    made = made or Tentative()
    create_run_folder(path, made=made)
    try:
        os.close(os.open(path / CAN_LOG_FILE, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except FileExistsError:
        raise _taken(path) from None
    except OSError as error:
        raise RunFolderError(f"{path / CAN_LOG_FILE}: cannot be written: {error.strerror}") from None
    made.made(path / CAN_LOG_FILE)
    for name in EMULATOR_FILES:
        made.file(path / name)
    return path


def later_run(folder: Path, number: int) -> Path:
    """Where run `number`, from 2 on, of the emulator that records into `folder` is recorded."""
    return folder / f"run-{number}"


def claim_later_run(path: Path) -> Path:
    """Make the folder of a later run for the emulator; the run's controller may have made it already.

    Raises `RunFolderError`.
    """
    create_run_folder(path, reuse=True)
    try:
        os.close(os.open(path / CAN_LOG_FILE, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except FileExistsError:
        raise _taken(path) from None
    return path


def new_run_folder(base: Path = Path("runs"), made: Tentative | None = None) -> Path:
    """A folder below `base` that no run has used, named by date and time, and noted in `made`."""
    made = made or Tentative()
    stamp = time.strftime("%Y%m%d-%H%M%S")
    try:
        made.folder(base)
        for suffix in range(1000):
            path = base / (stamp if not suffix else f"{stamp}-{suffix}")
            with contextlib.suppress(FileExistsError):
                path.mkdir()
                made.made(path)
                return create_run_folder(path, made=made)
    except OSError as error:
        raise RunFolderError(f"{error.filename or base}: cannot be made: {error.strerror}") from None
    raise RunFolderError(f"{base}: no free folder name for {stamp}")


def update_run_file(folder: Path, section: str, content: Any) -> None:
    """Set one section of `run.json`, in one piece: a reader sees the file before or after, never half of it.

    The file begins with the summary. With `None` the section goes.
    Raises `RunFolderError` for a file that cannot be read, `OSError` with its name for one that cannot be written.
    """
    with locked(folder / f".{RUN_FILE}.lock"):
        path = folder / RUN_FILE
        document = read_run_file(folder) if path.exists() else {}
        if content is None:
            document.pop(section, None)
        else:
            document[section] = content
        ordered = {name: document[name] for name in sorted(document, key=lambda name: (name != SUMMARY, name))}
        replace_file(path, (json.dumps(ordered, indent=2) + "\n").encode())


def read_run_file(folder: Path) -> dict[str, Any]:
    """`run.json` as a dict. Raises `RunFolderError`."""
    path = folder / RUN_FILE
    try:
        document = parse_json(read_text(path, LARGEST_RUN_FILE, "a run's record", "JSON"))
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise RunFolderError(f"{path}: cannot be read: {error}") from None
    if not isinstance(document, dict):
        raise RunFolderError(f"{path}: cannot be read: is no JSON object")
    return document


@dataclass(frozen=True)
class Rotation:
    """When a log goes on in a new file: the old one is called NAME-0001 then, and so on.

    `on_part` is given each part that is complete, and must not take long.
    """

    bytes: int
    on_part: Callable[[Path], None] = lambda path: None
    takes_last: bool = False
    """Whether what is left at the end is a part as well; the log itself is then gone."""


class _LineFile:
    """A text file, written out in whole lines now and then: neither a reader nor a `kill -9` finds half a line.

    Rows are kept as they are handed in; only all together they become text, in half the time.
    """

    _head = ""
    """What every part begins with."""

    def __init__(self, path: Path, *, append: bool = False, rotation: Rotation | None = None) -> None:
        self._place, self._appends, self._rotation = path, append, rotation
        self.parts = 0
        """So many parts have been completed."""
        self._open()
        self._rows: list[Any] = []

    def _open(self) -> None:
        path, append = self._place, self._appends
        try:
            self._file = os.fdopen(open_own(path, append=append), "ab" if append else "wb", buffering=0)
            try:
                append_lines(self._file.fileno(), self._head.encode("ascii", errors="backslashreplace"))
            except OSError:
                self._file.close()
                raise
        except OSError as error:
            raise RunFolderError(f"{path}: cannot be written: {error.strerror}") from None

    def _text(self, rows: list[Any]) -> Iterable[str]:
        """The lines of rows, each with its end."""
        raise NotImplementedError

    def _flush(self) -> None:
        """Write what has gathered in one piece. Raises `OSError`; what is on disk then ends with a whole line."""
        rows, self._rows = self._rows, []
        data = "".join(self._text(rows)).encode("ascii", errors="backslashreplace")
        append_lines(self._file.fileno(), data)
        if self._rotation is not None and os.fstat(self._file.fileno()).st_size >= self._rotation.bytes:
            self._rotate(self._rotation)

    def _rotate(self, rotation: Rotation) -> None:
        self._file.close()
        self.parts += 1
        part = part_of(self._place, self.parts)
        self._place.replace(part)
        self._open()
        rotation.on_part(part)

    def _end_parts(self, rotation: Rotation) -> None:
        """Nothing stays under the log's own name, unless nothing has been written at all."""
        if os.fstat(self._file.fileno()).st_size > len(self._head):
            self._file.close()
            self.parts += 1
            part = part_of(self._place, self.parts)
            self._place.replace(part)
            rotation.on_part(part)
        elif self.parts:
            self._file.close()
            self._place.unlink()

    def write_out(self) -> None:
        """Write what has gathered, if anything has. Raises `OSError`."""
        if self._rows:
            self._flush()

    def close(self) -> None:
        """Write out what is left. May be called again."""
        if self._file.closed:
            return
        try:
            self.write_out()
            if self._rotation is not None and self._rotation.takes_last:
                self._end_parts(self._rotation)
        finally:
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


_STAMP = "(%010d.%06d) "  # formatted by %: it takes half the time


def candump_line(time_ns: int, channel: str, frame: Frame) -> str:
    """One line of a candump log file (`candump -l`, can-utils lib.c): `(seconds.microseconds) channel id#data`."""
    return f"{_stamp(time_ns)}{_unstamped(channel, frame)}"


def _stamp(time_ns: int) -> str:
    microseconds = time_ns // 1000
    return _STAMP % (microseconds // 1_000_000, microseconds % 1_000_000)


def _unstamped(channel: str, frame: Frame) -> str:
    can_id, data, is_extended, is_remote = frame
    # candump writes R and the length that a remote frame asks for, unless that is 0 (can-utils, lib.c).
    payload = f"R{len(data) or ''}" if is_remote else data.hex().upper()
    identifier = f"{can_id:08X}" if is_extended else f"{can_id:03X}"
    return f"{channel} {identifier}#{payload}\n"


class CanLog(_LineFile):
    """A candump log of one bus, whose clock shows `LOG_START_S` at time 0."""

    def __init__(self, path: Path, channel: str = "can0", rotation: Rotation | None = None) -> None:
        super().__init__(path, rotation=rotation)
        self._channel = channel
        self._names: dict[int, str] = {}

    def write(self, time_ns: int, frame: Frame) -> None:
        """Append one frame."""
        self.write_all([(time_ns, frame, None)])

    def write_all(self, records: Iterable[tuple[int, Frame, object]]) -> None:
        """Append frames, each with its time and whatever else."""
        self._rows += records
        if len(self._rows) >= FLUSH_EVERY:
            self._flush()

    def _text(self, rows: list[tuple[int, Frame, object]]) -> Iterable[str]:
        lines, names, last_ns, stamp = [], self._names, -1, ""
        for time_ns, frame, _ in rows:
            if time_ns != last_ns:  # in lockstep most come with others of the same time
                last_ns, stamp = time_ns, _stamp(LOG_START_S * 1_000_000_000 + time_ns)
            can_id, data, is_extended, is_remote = frame
            if is_extended or is_remote:
                lines.append(stamp + _unstamped(self._channel, frame))
                continue
            name = names.get(can_id)
            if name is None:
                name = names[can_id] = f"{self._channel} {can_id:03X}#"
            lines.append(f"{stamp}{name}{data.hex().upper()}\n")
        return lines

    def size(self) -> int:
        """Bytes written so far; what has gathered is written out. Raises `OSError`."""
        self.write_out()
        return os.fstat(self._file.fileno()).st_size

    def append_from(self, other: Path, place: int) -> None:
        """Append what stands in another log from `place` on. Raises `OSError`."""
        with other.open("rb") as file:
            file.seek(place)
            while block := file.readlines(1 << 20):
                append_lines(self._file.fileno(), b"".join(block))


def row_format(columns: int) -> str:
    """The text of a row of signals, with so many columns after cycle and time."""
    return "%d,%.6f" + ",%.9g" * columns + "\n"


class SignalLog(_LineFile):
    """Signals of a run as CSV, one row per cycle; the first columns are `cycle` and `time_s`, and names have units."""

    def __init__(self, path: Path, columns: Sequence[str], rotation: Rotation | None = None) -> None:
        self._head = ",".join(("cycle", "time_s", *columns)) + "\n"
        super().__init__(path, rotation=rotation)
        self._format = row_format(len(columns))

    def write(self, cycle: int, time_ns: int, values: Iterable[float]) -> None:
        """Append one row; `time_ns` counts from cycle 0."""
        self._rows.append((cycle, time_ns * 1e-9, *values))
        if len(self._rows) >= FLUSH_EVERY:
            self._flush()

    def _text(self, rows: list[tuple[float, ...]]) -> Iterable[str]:
        return map(self._format.__mod__, rows)


class EventLog(_LineFile):
    """Events as JSON lines, appended whole, so that several processes can share the file.

    While one is open, its folder counts as being written to (`hold_folder`).

    Times are handed in on any clock, and written from cycle 0 on: `begin` says when that is. The time of an event
    before it is null until then, and negative afterwards.
    """

    def __init__(self, path: Path, source: str) -> None:
        super().__init__(path, append=True)
        self._path, self._source = path, source
        self._hold = hold_folder(path.parent)
        self._begin_ns: int | None = None
        self._timeless: list[tuple[int, int]] = []
        """Place in the file, and time, of events that came before cycle 0."""

    def close(self) -> None:
        """Let go of file and folder. May be called again."""
        super().close()
        if self._hold is not None:
            os.close(self._hold)
            self._hold = None

    def begin(self, time_ns: int) -> None:
        """Cycle 0 is at `time_ns`. Raises `OSError`."""
        self._begin_ns = time_ns
        timeless, self._timeless = self._timeless, []
        if timeless:
            descriptor = os.open(self._path, os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0))
            try:
                for place, early_ns in timeless:
                    os.lseek(descriptor, place, os.SEEK_SET)
                    os.write(descriptor, self._time(early_ns).encode("ascii"))
            finally:
                os.close(descriptor)

    def write(self, time_ns: int, event: str, **details: Any) -> None:
        """Append one event at once. Keys: `time_s`, `source`, `event`, and the details.

        Raises `OSError`; the file then ends with a whole line.
        """
        head = '{"time_s":'
        rest = json.dumps({"source": self._source, "event": event, **details})
        line = f"{head}{self._time(time_ns)}, {rest[1:]}\n".encode("ascii")
        append_lines(self._file.fileno(), line)
        if self._begin_ns is None:
            self._timeless.append((self._file.tell() - len(line) + len(head), time_ns))

    def _time(self, time_ns: int) -> str:
        text = "null" if self._begin_ns is None else f"{(time_ns - self._begin_ns) * 1e-9:.6f}"
        return text.rjust(TIME_WIDTH)
