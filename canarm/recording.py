"""A run whose record cannot be written: the failure is reported, and the run goes on."""

from collections.abc import Callable
from pathlib import Path

from canarm_protocol.runs.run_folder import RunFolderError


def recording_failure(folder: Path, write: Callable[[], None]) -> str | None:
    """Call `write`, which writes into the run folder; returns the reason of a failure on one line, or None."""
    try:
        write()
    except RunFolderError as error:
        return f"recording failed: {error}"
    except OSError as error:
        return f"{error.filename or folder}: recording failed: {error.strerror or error}"
    return None
