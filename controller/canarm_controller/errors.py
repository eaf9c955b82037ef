"""Errors of the controller's side: one line each, saying what is wrong, where, and what would be right."""

from canarm_protocol.errors import CanarmError, ExitStatus


class ControllerError(CanarmError):
    """Base of every error raised by `canarm_controller`."""


class DynamicsError(ControllerError):
    """A state or a robot cannot be put into the equations of motion, or they have no solution."""


class CooperationError(ControllerError):
    """Two arms and an object, or a path for them, cannot be used: another shape, or numbers that fit nothing."""


class TrajectoryError(ControllerError):
    """A trajectory cannot be read, or asks for what the robot cannot do."""


class LawError(ControllerError):
    """A control law cannot be loaded, or fails while it runs."""


class InterruptedRunError(ControllerError):
    """The user has asked to stop (Ctrl-C) while a law's own code ran, or before the run had begun."""

    exit_status = ExitStatus.FAILED


class MemoryImageError(ControllerError):
    """A table or a log does not fit the Apple II's memory."""


class BringUpError(ControllerError):
    """The cards cannot be found, identified or configured, or the bus has another master."""

    exit_status = ExitStatus.FAILED


class ClockMismatchError(BringUpError):
    """The emulated world and the controller follow different clocks."""

    exit_status = ExitStatus.WRONG_INPUT
