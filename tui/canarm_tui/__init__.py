"""The terminal dashboard, and the monitor of any bus. What the dashboard knows comes over the bench bus."""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from .app import DashboardApp
    from .entry import run_dashboard
    from .errors import TerminalError, TuiError

__all__ = ["DashboardApp", "TerminalError", "TuiError", "run_dashboard"]

__getattr__ = loader(__name__, __all__, ".errors", ".app", ".entry")
