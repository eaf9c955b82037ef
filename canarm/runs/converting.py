"""A run in the formats of other tools, written by the libraries that own them, beside what was recorded.

Nothing is computed here: times count as in the run's own files.
"""

import contextlib
import io
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from canarm_protocol.canopen.frames import ERROR_FLAG, Frame
from canarm_protocol.errors import CanarmError
from canarm_protocol.runs.can_log import log_frames
from canarm_protocol.runs.own_file import replace_file
from canarm_protocol.runs.packing import SUFFIX, pack
from canarm_protocol.runs.parts import part_of, parts_of
from canarm_protocol.runs.run_folder import (
    BENCH_LOG_FILE,
    CAN_LOG_FILE,
    LOG_START_S,
    SIGNALS_FOLDER,
    RunFolderError,
    row_format,
)
from canarm_protocol.shown import first_line

from ..libraries import load_library
from .run import Run

UNITS = {
    "_rad_s2": "rad/s²",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_nm": "N·m",
    "_deg": "°",
    "_lsb": "LSB",
    "_a": "A",
    "_n": "N",
    "_m": "m",
    "_s": "s",
}
"""Endings of the names of columns, the longest first."""
TABLES = ("robot", "controller")


def convert(run: Run, format_: str) -> list[Path]:
    """Write `run` in one of `FORMATS` into its folder; returns the files.

    Raises `MissingLibraryError`, and `RunFolderError` where it cannot be done.
    """
    try:
        return FORMATS[format_](run)
    except OSError as error:
        raise RunFolderError(f"{error.filename or run.path}: cannot be written: {error.strerror or error}") from None


def convert_all(folder: Path, formats: Iterable[str], tell: Callable[[str], None]) -> bool:
    """Write the run in `folder`, which is over, in all `formats`; False, and a line, where one cannot be written."""
    is_whole = True
    for each in formats:
        try:
            convert(Run(folder), each)
        except CanarmError as error:
            is_whole = False
            tell(str(error))
    return is_whole


def unit_of(column: str) -> str:
    """The unit that the name of a column ends in; empty without one."""
    return next((unit for ending, unit in UNITS.items() if column.endswith(ending)), "")


def _to_blf(run: Run) -> list[Path]:
    """python-can's BLF: the same frames, the same bytes; of the bench's own bus too, if they are recorded."""
    bench = [BENCH_LOG_FILE] if any(each.is_file() for each in parts_of(run.path / BENCH_LOG_FILE)) else []
    return [_frames_file(run, log, ".blf", can.BLFWriter) for log in (CAN_LOG_FILE, *bench)]


def _to_mf4(run: Run) -> list[Path]:
    """Frames by python-can's writer, as a logged bus; signals with their units by asammdf."""
    asammdf = load_library("asammdf", "MF4")
    frames = _frames_file(run, CAN_LOG_FILE, ".mf4", can.MF4Writer)
    file = asammdf.MDF(version="4.10")
    for table, columns in ((name, getattr(run, name)) for name in TABLES):
        signals = [
            asammdf.Signal(values, columns["time_s"], name=f"{table}.{name}", unit=unit_of(name))
            for name, values in columns.items()
            if name != "time_s"
        ]
        if signals and len(columns["time_s"]):
            file.append(signals, comment=table)
    path = run.path / "signals.mf4"
    with _drafted(path, path.with_name(f".{path.name}.mf4")) as draft:
        file.save(draft, overwrite=True)
        file.close()
    return [frames, path]


def _to_mcap(run: Run) -> list[Path]:
    """A channel for each joint, one for the events, one for the frames: JSON, with schemas."""
    writer_of = load_library("mcap.writer", "MCAP").Writer
    data = io.BytesIO()
    writer = writer_of(data)
    writer.start(library="canarm")
    for table, columns in ((name, getattr(run, name)) for name in TABLES):
        groups: dict[str, list[str]] = {}
        for name in columns:
            if "." in name:
                groups.setdefault(name.split(".")[0], []).append(name)
        for group, names in groups.items():
            fields = {name.partition(".")[2]: {"type": "number", "description": unit_of(name)} for name in names}
            channel = _channel(writer, f"/{table}/{group}", {"cycle": {"type": "integer"}, **fields})
            rows = zip(
                columns["time_s"].tolist(),
                columns["cycle"].tolist(),
                *(columns[n].tolist() for n in names),
                strict=True,
            )
            for time_s, cycle, *values in rows:
                _message(writer, channel, time_s, {"cycle": int(cycle), **dict(zip(fields, values, strict=True))})
    channel = _channel(writer, "/events", {"event": {"type": "string"}, "cycle": {"type": "integer"}})
    for event in run.event_list:
        _message(writer, channel, event["time_s"], event)
    fields = {"id": {"type": "integer"}, "data": {"type": "string", "description": "hexadecimal"}}
    channel = _channel(writer, "/can0", fields)
    for time_ns, frame in log_frames(run.path / CAN_LOG_FILE):
        row = {"id": frame.can_id & (ERROR_FLAG - 1), "data": frame.data.hex().upper()}
        _message(writer, channel, time_ns * 1e-9 - run.begin_s, row)
    writer.finish()
    path = run.path / "run.mcap"
    replace_file(path, data.getvalue())
    return [path]


def _to_parquet(run: Run) -> list[Path]:
    """The parts of the signals that are still CSV; what stands in the CSV file itself becomes the last part."""
    load_library("pyarrow", "Parquet")
    written = []
    for table in TABLES:
        path = run.path / SIGNALS_FOLDER / f"{table}.csv"
        *parts, last = parts_of(path, SUFFIX)
        written += [_packed(part) for part in parts if part.suffix != SUFFIX]
        if last.is_file() and last.stat().st_size and not last.is_symlink():
            text = last.read_bytes()
            head = text[: text.find(b"\n") + 1]
            if len(head) < len(text):
                part = _next_part(path, parts)
                last.replace(part)
                try:
                    written.append(_packed(part))
                except (OSError, RunFolderError):  # a full disk: all is as it was
                    part.replace(path)
                    raise
            elif parts:
                last.unlink()
    return written


def _packed(part: Path) -> Path:
    try:
        return pack(part)
    except OSError:
        raise
    except Exception as error:  # whatever a damaged file makes of the library
        raise RunFolderError(f"{part}: cannot be packed: {first_line(error)}") from None


def _to_csv(run: Run) -> list[Path]:
    """The parts of the signals that are Parquet, as CSV with the digits that they have; a single part is the file."""
    parquet = load_library("pyarrow.parquet", "CSV of Parquet")
    written = []
    for table in TABLES:
        path = run.path / SIGNALS_FOLDER / f"{table}.csv"
        packed = [part for part in parts_of(path, SUFFIX) if part.suffix == SUFFIX]
        texts = [_unpacked(part, parquet) for part in packed]
        *parts, last = parts_of(path, SUFFIX)
        if len(parts) == 1 and texts and not last.exists():
            written.append(texts[0].rename(path))
        else:
            written += texts
    return written


def _unpacked(part: Path, parquet: Any) -> Path:
    """Replace a Parquet file by CSV, whose path is returned: the shortest text of each number that it has."""
    try:
        table = parquet.read_table(part)
        names, columns = table.column_names, [_shortest(column.to_numpy()) for column in table.columns]
        if names[:2] != ["cycle", "time_s"]:
            raise ValueError("has no columns cycle and time_s")
    except Exception as error:  # whatever a damaged file makes of the library
        raise RunFolderError(f"{part}: cannot be unpacked: {first_line(error)}") from None
    rows = map(row_format(len(names) - 2).__mod__, zip(*columns, strict=True))
    path = part.with_suffix(".csv")
    replace_file(path, (",".join(names) + "\n" + "".join(rows)).encode("ascii", errors="backslashreplace"))
    part.unlink()
    return path


def _shortest(column: NDArray[Any]) -> list[float]:
    """Numbers of single precision as the doubles that are written alike: 0.1 and not 0.100000001."""
    return list(column.astype("U32").astype(np.float64).tolist() if column.dtype == np.float32 else column.tolist())


def _next_part(path: Path, parts: Sequence[Path]) -> Path:
    """The part after the last of `parts`, of which some may have been lost."""
    last = int(parts[-1].stem.rpartition("-")[2]) if parts else 0
    return part_of(path, last + 1)


FORMATS: Mapping[str, Callable[[Run], list[Path]]] = {
    "blf": _to_blf,
    "csv": _to_csv,
    "mcap": _to_mcap,
    "mf4": _to_mf4,
    "parquet": _to_parquet,
}
"""Format → what writes it."""


def _frames_file(run: Run, log: str, suffix: str, writer: Callable[..., Any]) -> Path:
    path = (run.path / log).with_suffix(suffix)
    with _drafted(path, path.with_name(f".draft-{path.name}")) as draft, writer(draft) as file:
        for time_ns, frame in log_frames(run.path / log):
            file.on_message_received(_message_of(time_ns, frame))
    return path


@contextlib.contextmanager
def _drafted(path: Path, draft: Path) -> Iterator[Path]:
    """What is written into `draft` takes the place of `path`, whole or not at all. Raises `OSError`, which names it."""
    try:
        yield draft
        draft.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None


def _message_of(time_ns: int, frame: Frame) -> can.Message:
    is_error = frame.can_id >= ERROR_FLAG
    return can.Message(
        timestamp=LOG_START_S + time_ns * 1e-9,
        arbitration_id=frame.can_id & (ERROR_FLAG - 1),
        data=None if frame.is_remote else frame.data,
        dlc=len(frame.data),
        is_extended_id=frame.is_extended and not is_error,
        is_remote_frame=frame.is_remote,
        is_error_frame=is_error,
        channel=0,
    )


def _channel(writer: Any, topic: str, fields: Mapping[str, Any]) -> int:
    schema = json.dumps({"type": "object", "properties": fields}).encode()
    schema_id = writer.register_schema(name=topic.strip("/").replace("/", "."), encoding="jsonschema", data=schema)
    return int(writer.register_channel(topic=topic, message_encoding="json", schema_id=schema_id))


def _message(writer: Any, channel: int, time_s: float, fields: Mapping[str, Any]) -> None:
    """MCAP has no time before 0: cycle 0 is at `LOG_START_S`."""
    time_ns = max(round((LOG_START_S + max(time_s, -LOG_START_S)) * 1e9), 0)
    told = {"time_s": time_s, **fields}
    known = {
        key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in told.items()
    }
    writer.add_message(channel_id=channel, log_time=time_ns, publish_time=time_ns, data=json.dumps(known).encode())
