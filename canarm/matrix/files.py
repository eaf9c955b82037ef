"""The folder of a matrix: its files, claimed before the first run, so that no older matrix is lost."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from ..usage import UsageError
from .html_report import as_html
from .table import Matrix, as_csv

CSV_FILE, HTML_FILE = "matrix.csv", "matrix.html"
PARTIAL_CSV_FILE, PARTIAL_HTML_FILE = "matrix-partial.csv", "matrix-partial.html"
"""What an interrupted campaign leaves."""


@contextlib.contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Make the folder, and keep it for one matrix: of several that try at the same time, all but one are refused.

    A claim that nothing was written into is given back. Raises `UsageError` where there is a matrix already, or no
    folder can be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out {folder}: is no folder and cannot become one: {error.strerror}") from None
    if any((folder / name).exists() for name in (HTML_FILE, PARTIAL_CSV_FILE, PARTIAL_HTML_FILE)):
        raise _taken(folder)
    try:
        os.close(os.open(folder / CSV_FILE, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except FileExistsError:
        raise _taken(folder) from None
    except OSError as error:
        raise UsageError(f"--out {folder}: {CSV_FILE} cannot be written: {error.strerror}") from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            if not (folder / CSV_FILE).stat().st_size:
                (folder / CSV_FILE).unlink()


def write(folder: Path, matrix: Matrix) -> list[Path]:
    """Write the table and the page, under other names where the matrix is partial. Returns their paths.

    Raises `UsageError` for a file that cannot be written.
    """
    names = (PARTIAL_CSV_FILE, PARTIAL_HTML_FILE) if matrix.runs_left else (CSV_FILE, HTML_FILE)
    paths = [folder / name for name in names]
    for path, text in zip(paths, (as_csv(matrix.rows), as_html(matrix)), strict=True):
        try:
            path.write_text(text, encoding="utf-8", newline="")
        except OSError as error:
            raise UsageError(f"--out {folder}: {path.name} cannot be written: {error.strerror}") from None
    return paths


def _taken(folder: Path) -> UsageError:
    return UsageError(f"--out {folder}: holds a matrix already; name another folder, or remove it")
