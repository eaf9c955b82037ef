"""The terminal dashboard: watches the bench bus, and knows nothing but what goes over it."""

from .app import DashboardApp, run_dashboard
from .errors import TerminalError, TuiError

__all__ = ["DashboardApp", "TerminalError", "TuiError", "run_dashboard"]
