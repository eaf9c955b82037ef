"""What a run leaves behind: its folder, and figures gathered on the way."""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from .histogram import Histogram
    from .run_folder import CanLog, EventLog, RunFolderError, SignalLog, read_run_file

__all__ = ["CanLog", "EventLog", "Histogram", "RunFolderError", "SignalLog", "read_run_file"]

__getattr__ = loader(__name__, __all__, ".run_folder", ".histogram")
