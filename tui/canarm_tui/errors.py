"""Errors of the dashboard. A lost bus is no error: the dashboard shows it and goes on."""

from canarm_protocol.errors import CanarmError


class TuiError(CanarmError):
    """Base of every error raised by `canarm_tui`."""


class TerminalError(TuiError):
    """There is no terminal to draw on."""
