"""Errors of the dashboard. A lost bus is no error here: it is shown, and the dashboard stays."""


class TuiError(Exception):
    """Base of every error raised by `canarm_tui`."""


class TerminalError(TuiError):
    """There is no terminal to draw on."""
