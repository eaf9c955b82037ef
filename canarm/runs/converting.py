"""A run in the formats of other tools, written by the libraries that own them, beside what was recorded.

Nothing is computed here: times count as in the run's own files.
"""

import io
import json
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import can

from canarm_protocol.canopen.frames import ERROR_FLAG, Frame
from canarm_protocol.errors import CanarmError
from canarm_protocol.runs.can_log import log_frames
from canarm_protocol.runs.own_file import replace_file
from canarm_protocol.runs.packing import SUFFIX, pack
from canarm_protocol.runs.run_folder import (
    BENCH_LOG_FILE,
    CAN_LOG_FILE,
    LOG_START_S,
    SIGNALS_FOLDER,
    RunFolderError,
    part_of,
    parts_of,
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
    draft = path.with_name(f".{path.name}.mf4")
    Path(file.save(draft, overwrite=True)).replace(path)
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
    """The parts of the signals that are still CSV. Of signals that are whole, the CSV file becomes the last part."""
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
                part = part_of(path, len(parts) + 1)
                last.replace(part)
                try:
                    replace_file(path, head)
                    written.append(_packed(part))
                except (OSError, RunFolderError):  # a full disk: all is as it was
                    part.replace(path)
                    raise
    return written


def _packed(part: Path) -> Path:
    try:
        return pack(part)
    except Exception as error:  # whatever a damaged file makes of the library
        raise RunFolderError(f"{part}: cannot be packed: {first_line(error)}") from None


FORMATS: Mapping[str, Callable[[Run], list[Path]]] = {
    "blf": _to_blf,
    "mcap": _to_mcap,
    "mf4": _to_mf4,
    "parquet": _to_parquet,
}
"""Format → what writes it."""


def _frames_file(run: Run, log: str, suffix: str, writer: Callable[..., Any]) -> Path:
    path = (run.path / log).with_suffix(suffix)
    draft = path.with_name(f".draft-{path.name}")
    with writer(draft) as file:
        for time_ns, frame in log_frames(run.path / log):
            file.on_message_received(_message_of(time_ns, frame))
    draft.replace(path)
    return path


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
