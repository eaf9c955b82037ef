"""A record that cannot be written: it ends, with a reason, and the run goes on."""

from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from .run_folder import RunFolderError

UNWRITABLE = OSError, RunFolderError
"""What ends a record."""


class Unwritten:
    """As a context: an `OSError`, or `RunFolderError`, of what is written in it is the reason, told once.

    Reentrant. `folder` is named where an error names no file.
    """

    __slots__ = ("_folder", "_tell", "why")

    def __init__(self, folder: Path, tell: Callable[[str], None] = lambda text: None) -> None:
        self.why: str | None = None
        """Why the record is not whole; None while it is."""
        self._folder, self._tell = folder, tell

    def __enter__(self) -> None:
        return None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if not isinstance(error, UNWRITABLE):
            return False
        self.note(error)
        return True

    def note(self, error: OSError | RunFolderError) -> None:
        """The reason, from now on."""
        if self.why is None:
            what = error.strerror or error if isinstance(error, OSError) else error
            where = f"{getattr(error, 'filename', None) or self._folder}: "
            self.why = f"{where if isinstance(error, OSError) else ''}recording failed: {what}"
            self._tell(f"{self.why}; the run goes on, unrecorded from here on")
