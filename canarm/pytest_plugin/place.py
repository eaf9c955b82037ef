"""Checks a folder that the user names before any test runs. Nothing else of canarm is imported here."""

import contextlib
import tempfile
from pathlib import Path


def usable_folder(path: Path) -> None:
    """Make sure that files can be written below `path`, and leave nothing there. Raises `OSError`."""
    made: list[Path] = []
    try:
        for folder in (*reversed(path.parents), path):
            if not folder.is_dir():
                folder.mkdir(exist_ok=True)
                made.append(folder)
        with tempfile.TemporaryFile(dir=path):
            pass
    finally:
        for folder in reversed(made):
            with contextlib.suppress(OSError):  # in use already, by another run
                folder.rmdir()
