"""Errors of the emulator: every message says what is wrong, where, and what would be right."""

from canarm_protocol.errors import CanarmError, ExitStatus


class EmulatorError(CanarmError):
    """Base of every error raised by `canarm_emulator`."""

    exit_status = ExitStatus.FAILED


class TruthError(EmulatorError):
    """A key or value of `--truth` is wrong."""

    exit_status = ExitStatus.WRONG_INPUT


class HubError(EmulatorError):
    """The virtual bus cannot be served at the given address."""

    exit_status = ExitStatus.WRONG_INPUT


class RefusedError(HubError):
    """The machine refuses to serve it there: a port that is taken, for example."""

    exit_status = ExitStatus.FAILED
