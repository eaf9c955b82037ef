"""The terminal dashboard. All it knows comes over the bench bus."""

from .app import DashboardApp, run_dashboard
from .errors import TerminalError, TuiError

__all__ = ["DashboardApp", "TerminalError", "TuiError", "run_dashboard"]
