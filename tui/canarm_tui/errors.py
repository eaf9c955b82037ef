"""Errors of the dashboard. A lost bus is no error: the dashboard shows it and goes on."""

from canarm_protocol.errors import BusError, CanarmError, ExitStatus


class TuiError(CanarmError):
    """Base of every error raised by `canarm_tui`."""


class NotConnectedError(TuiError, BusError):
    """Nothing can be sent: there is no bus."""


class TerminalError(TuiError):
    """There is no terminal to draw on."""


class BrokenError(TuiError):
    """The dashboard has ended with an error that nobody has foreseen."""

    exit_status = ExitStatus.FAILED
