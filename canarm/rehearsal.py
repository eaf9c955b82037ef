"""A cell is tried out before it is called right: bench and controller are built of it, and run for a moment.

Whatever passes runs; rules that can be told from the file alone belong to the schema and its checks.
"""

from collections.abc import Iterator

from canarm_controller.errors import ControllerError, TrajectoryError
from canarm_controller.laws.loading import LAWS
from canarm_controller.reference.trajectory import BUILT_IN, make_trajectory
from canarm_controller.run.state import State
from canarm_emulator.errors import EmulatorError
from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock

from .rig.rig import Rig
from .session import make_controller
from .usage import DEFAULT_LAW, UsageError

REHEARSED_S = 2.0
"""The entry into the motion: what the robot cannot follow at all has shown by then."""


def rehearse(cell: Cell) -> Iterator[str]:
    """Try `cell` with each law, and run it; a line for each thing that works, or that one motion alone does not.

    Raises `UsageError` with the reason where it cannot run.
    """
    fitting = []
    for motion in BUILT_IN:
        try:
            make_trajectory(motion, cell)
        except TrajectoryError as error:
            refusal = str(error)
            yield f"motion {refusal}"
        except ControllerError as error:
            raise UsageError(f"no model of the arm: {error}") from None
        else:
            fitting.append(motion)
    if not fitting:
        raise UsageError(f"no built-in motion fits: {refusal}")
    for law in LAWS:
        try:
            make_controller(cell, law, fitting[0], None, Clock.SYNC)
        except ControllerError as error:
            yield f"law {law}: cannot be used: {error}"
    try:
        with Rig(cell, DEFAULT_LAW, fitting[0]) as rig:
            rig.run(REHEARSED_S)
            stopped = rig.reason if rig.state is not State.RUNNING else None
    except (ControllerError, EmulatorError, ArithmeticError, ValueError) as error:
        raise UsageError(f"cannot run: {error}") from None
    if stopped is not None:
        raise UsageError(f"was stopped within {REHEARSED_S:g} s: {stopped}")
    yield f"ran for {REHEARSED_S:g} s with {DEFAULT_LAW} on {fitting[0]}"
