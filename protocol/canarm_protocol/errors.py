"""The root of all errors, and those of the contract between the programs.

Every message says what is wrong, where, and what would be right. An error has the exit status of the command that it
ends; the other packages derive their errors from `CanarmError`.
"""

from enum import IntEnum

from .shown import printable_lines


class ExitStatus(IntEnum):
    """How a command ends."""

    DONE = 0
    FAILED = 1
    """The run failed, or ended in a safe stop."""
    WRONG_INPUT = 2
    """The command line, a cell or another file is wrong."""


class CanarmError(Exception):
    """Root of every error that is raised on purpose; `exit_status` is the status of a command that it ends."""

    exit_status = ExitStatus.WRONG_INPUT

    def __str__(self) -> str:
        """The message, safe for a terminal even if it quotes foreign text."""
        return printable_lines(super().__str__())


class UsageError(CanarmError, ValueError):
    """An impossible request by the user: exit status 2, and in Python a `ValueError`."""


class ProtocolError(CanarmError):
    """Base of every error raised by `canarm_protocol`."""


class CellError(ProtocolError):
    """A cell file, or a key laid over it, is wrong."""


class DictionaryError(ProtocolError):
    """An EDS file or a PDO mapping in it cannot be used."""


class FrameError(ProtocolError):
    """A frame or a line of text does not follow its protocol."""


class BusError(ProtocolError):
    """A CAN bus cannot be opened, or is lost."""

    exit_status = ExitStatus.FAILED


class BusOptionsError(BusError):
    """A bus is asked for with options that it does not take."""

    exit_status = ExitStatus.WRONG_INPUT


class FaultError(ProtocolError):
    """A fault file, a set of faults or one of their conditions is wrong, or not supported where it is to act."""
