"""Folders and files that a command makes before it is clear that it goes on: one that is refused leaves nothing behind.

Only what is noted here is ever removed, and a folder only if it is empty: others may write into it as well.
"""

import contextlib
import errno
import os
from itertools import takewhile
from pathlib import Path
from types import TracebackType
from typing import Self

from ..errors import CanarmError


class Tentative:
    """What has been made so far. A `CanarmError` or `OSError` that leaves a `with` statement takes it back."""

    def __init__(self) -> None:
        self._made: list[Path] = []

    def folder(self, path: Path) -> None:
        """Make `path` with its parents, unless it is there. Raises `OSError`; nothing has then been made."""
        absent = list(takewhile(lambda each: not os.path.lexists(each), (path, *path.parents)))
        before = len(self._made)
        try:
            for each in reversed(absent):
                with contextlib.suppress(FileExistsError):
                    each.mkdir()
                    self._made.append(each)
            if not path.is_dir():
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
        except OSError:
            self._take_back(before)
            raise

    def made(self, path: Path) -> None:
        """`path` has just been made, here and by nobody else."""
        self._made.append(path)

    def file(self, path: Path) -> None:
        """`path` will be made. It is not ours if it is there already."""
        if not os.path.lexists(path):
            self._made.append(path)

    def keep(self) -> None:
        """It goes on: what has been made stays."""
        self._made.clear()

    def take_back(self) -> None:
        """Remove what has been made, as far as possible. May be called again."""
        self._take_back(0)

    def _take_back(self, first: int) -> None:
        while len(self._made) > first:
            path = self._made.pop()
            with contextlib.suppress(OSError):
                if path.is_dir() and not path.is_symlink():
                    path.rmdir()
                else:
                    path.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, CanarmError | OSError):
            self.take_back()
