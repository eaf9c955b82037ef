"""What becomes of a run whose record cannot be written: it is told, and nothing else is lost with it."""

from collections.abc import Callable
from pathlib import Path

from canarm_protocol.runs.run_folder import RunFolderError


def recording_failure(folder: Path, write: Callable[[], None]) -> str | None:
    """Call `write`, which writes into the run folder; why that failed, on one line, or None."""
    try:
        write()
    except RunFolderError as error:
        return f"recording failed: {error}"
    except OSError as error:
        return f"{error.filename or folder}: recording failed: {error.strerror or error}"
    return None
