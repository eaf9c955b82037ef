"""The folder of a matrix: its files, claimed before the first run, so that no older matrix is lost."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from canarm_protocol.runs.own_file import open_own, replace_file, write_all
from canarm_protocol.runs.tentative import Tentative

from ..usage import UsageError
from .html_report import as_html
from .table import Matrix, as_csv, cells_csv

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # no POSIX: an empty claim left by a killed campaign then looks like one that is held
    fcntl = None

CSV_FILE, HTML_FILE, DRAWS_FILE = "matrix.csv", "matrix.html", "matrix-draws.csv"
PARTIAL_CSV_FILE, PARTIAL_HTML_FILE = "matrix-partial.csv", "matrix-partial.html"
PARTIAL_DRAWS_FILE = "matrix-partial-draws.csv"
"""Files of an interrupted campaign."""

OTHER_FILES = (HTML_FILE, DRAWS_FILE, PARTIAL_CSV_FILE, PARTIAL_HTML_FILE, PARTIAL_DRAWS_FILE)


@contextlib.contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Make the folder, and reserve it for one matrix: of several campaigns at the same time, all but one are refused.

    An unused claim is given back; one left by a killed campaign is taken over. Raises
    `UsageError` if there is a matrix already, or the folder cannot be made.
    """
    made = Tentative()
    try:
        made.folder(folder)
    except OSError as error:
        raise UsageError(f"--out {folder}: is no folder and cannot become one: {error.strerror}") from None
    if any((folder / name).exists() for name in OTHER_FILES):
        raise _taken(folder)
    held = _claim(folder)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            if not (folder / CSV_FILE).stat().st_size:
                (folder / CSV_FILE).unlink()
        os.close(held)
        made.take_back()  # a folder in which there is nothing


def write(folder: Path, matrix: Matrix) -> list[Path]:
    """Write the table of cells, the page and, where a cell has several draws, the table of all runs.

    Under other names where the matrix is partial. Returns their paths. Raises `OSError` with the name of the file;
    nothing is then left of it.
    """
    cells, is_partial = matrix.cells, bool(matrix.runs_left)
    texts = {
        PARTIAL_CSV_FILE if is_partial else CSV_FILE: cells_csv(cells),
        PARTIAL_HTML_FILE if is_partial else HTML_FILE: as_html(matrix),
    }
    if len(matrix.rows) > len(cells):
        texts[PARTIAL_DRAWS_FILE if is_partial else DRAWS_FILE] = as_csv(matrix.rows)
    for name, text in texts.items():
        if name == CSV_FILE:
            _fill_claim(folder / name, text.encode())
        else:
            replace_file(folder / name, text.encode())
    return [folder / name for name in texts]


def _fill_claim(path: Path, data: bytes) -> None:
    """Write into the claimed file, without replacing it."""
    with os.fdopen(open_own(path), "wb", buffering=0) as file:
        try:
            write_all(file.fileno(), data)
        except OSError as error:
            file.truncate(0)
            raise OSError(error.errno, error.strerror, str(path)) from None


def _claim(folder: Path) -> int:
    """The descriptor of the table's empty file, which is ours as long as it is open. Raises `UsageError`."""
    path = folder / CSV_FILE
    try:
        try:
            held = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
        except FileExistsError:
            if fcntl is None:
                raise
            held = os.open(path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
    except FileExistsError:
        raise _taken(folder) from None
    except OSError as error:
        raise UsageError(f"--out {folder}: {CSV_FILE} cannot be written: {error.strerror}") from None
    if fcntl is not None and not _is_ours(fcntl, held, path):
        os.close(held)
        raise _taken(folder)
    return held


def _is_ours(fcntl: ModuleType, held: int, path: Path) -> bool:
    """Whether nobody else holds the file, it is empty, and it is still the one at `path`."""
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return not os.fstat(held).st_size and os.path.samestat(os.fstat(held), path.stat())
    except OSError:
        return False


def _taken(folder: Path) -> UsageError:
    return UsageError(f"--out {folder}: holds a matrix already; name another folder, or remove it")
