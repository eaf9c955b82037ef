"""Errors of the emulator: every message says what is wrong, where, and what would be right."""


class EmulatorError(Exception):
    """Base of every error raised by `canarm_emulator`."""


class TruthError(EmulatorError):
    """A key or value of `--truth` is wrong."""


class HubError(EmulatorError):
    """The virtual bus cannot be served where it was asked for."""
