"""The rows of a study as they come: a file that is only ever appended to, a line a run.

A study that was killed goes on where it was: what is left of a cut line is removed, and its run is done again.
"""

import contextlib
import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Self

from canarm_protocol.runs.own_file import append_lines, open_own, replace_file
from canarm_protocol.shown import first_line

from ..usage import UsageError
from .one_run import STATES
from .plan import LARGEST_WHOLE

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # no POSIX: two studies in one folder are then not told apart
    fcntl = None

STUDY_FILE, ROWS_FILE = "study.json", "rows.jsonl"
LARGEST_BYTES = 4 << 20
LONGEST_ROW = 1 << 20


class Journal:
    """The rows of the study described by `study` in `folder`, which is made; use it in a `with` statement.

    `places` says where in the file each run is that is done. Raises `UsageError` where the folder holds another
    study, or one that goes on.
    """

    def __init__(self, folder: Path, study: Mapping[str, Any]) -> None:
        self.folder, self.path = folder, folder / ROWS_FILE
        self.places: dict[int, int] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._held = _claimed(folder, study)
        except OSError as error:
            where = error.filename or folder
            raise UsageError(f"--out {folder}: {where}: {error.strerror or first_line(error)}") from None
        try:
            self._descriptor = open_own(self.path, append=True)
            self._read()
        except OSError as error:
            os.close(self._held)
            raise UsageError(f"{self.path}: {error.strerror or first_line(error)}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._descriptor)
        os.close(self._held)

    def add(self, row: Mapping[str, Any]) -> None:
        """Append one row. Raises `OSError`, as on a full disk; the file then ends with the row before."""
        place = os.fstat(self._descriptor).st_size
        line = json.dumps(row, allow_nan=False, ensure_ascii=False, separators=(",", ":")) + "\n"
        try:
            append_lines(self._descriptor, line.encode())
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from None
        self.places[row["run"]] = place

    def rows(self) -> Iterator[dict[str, Any]]:
        """The rows, in the order of their runs; one at a time is in memory."""
        with self.path.open("rb") as file:
            for number in sorted(self.places):
                file.seek(self.places[number])
                yield json.loads(file.readline(LONGEST_ROW))

    def _read(self) -> None:
        place = 0
        with self.path.open("rb") as file:
            while line := file.readline(LONGEST_ROW):
                if len(line) == LONGEST_ROW and not line.endswith(b"\n"):  # whoever has written that; the rest is read
                    place += len(line)
                    continue
                if not line.endswith(b"\n"):
                    os.ftruncate(self._descriptor, place)  # a kill in the middle of a line
                    break
                number = _run_of(line)
                if number is not None:
                    self.places[number] = place
                place += len(line)


def _run_of(line: bytes) -> int | None:
    """The number of the run whose row the line is; None if it is no row: then the run is not done."""
    try:
        row = json.loads(line)
        if not isinstance(row, dict) or type(row.get("run")) is not int or row.get("state") not in STATES:
            return None
        return row["run"] if all(map(_is_plain, row.values())) and all(map(_is_plain, row)) else None
    except (ValueError, RecursionError, TypeError):
        return None


def _is_plain(value: Any) -> bool:
    """Whether a table can hold it. Raises `ValueError` for half a character."""
    if isinstance(value, str):
        value.encode()
        return True
    if isinstance(value, float):
        return math.isfinite(value)
    return value is None or (isinstance(value, int) and abs(value) <= LARGEST_WHOLE)


def fingerprint(paths: set[Path]) -> dict[str, str]:
    """A digest of each file that a study names: one that was edited makes another study of it."""
    found = {}
    for path in sorted(paths):
        with contextlib.suppress(OSError):
            if path.is_file():
                found[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def _claimed(folder: Path, study: Mapping[str, Any]) -> int:
    """The descriptor of the folder's description, which is ours as long as it is open."""
    path, text = folder / STUDY_FILE, (json.dumps(study, indent=1, ensure_ascii=False) + "\n").encode()
    if not path.exists():
        replace_file(path, text)
    held = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
    try:
        if os.read(held, LARGEST_BYTES) != text:
            raise UsageError(
                f"--out {folder}: holds another study, or this one with other settings, files or version; name "
                "another folder, or remove it"
            )
        if fcntl is not None:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(held)
        raise UsageError(f"--out {folder}: this study goes on in another process") from None
    except UsageError:
        os.close(held)
        raise
    except OSError:  # a file system without locks
        return held
    return held
