"""A run folder as its user names it, and where it is: the code of a user may change the working folder meanwhile."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from .run_folder import RunFolderError


@dataclass(frozen=True)
class OutFolder:
    """Written is into `path`; messages have it as `given`."""

    given: Path
    path: Path

    @classmethod
    def at(cls, given: Path) -> Self:
        """The folder that `given` is from the present working folder."""
        return cls(given, given.absolute())

    def said(self, text: str) -> str:
        """`text`, in which the folder is called as it was given."""
        return text.replace(str(self.path), str(self.given))

    @contextlib.contextmanager
    def named(self) -> Iterator[None]:
        """A `RunFolderError` that leaves this calls the folder as it was given."""
        try:
            yield
        except RunFolderError as error:
            raise RunFolderError(self.said(str(error))) from None
