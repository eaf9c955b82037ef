"""Tries a cell before it is called right: bench and controller are built from it and run briefly.

Whatever passes runs, and detects nothing where nothing is wrong; rules that can be told from the file alone belong to
the schema and its checks, those that take the arm's model to `soundness.py`.
"""

from collections.abc import Iterable, Iterator

from canarm_controller.errors import ControllerError, LawError, TrajectoryError
from canarm_controller.laws.loading import LAWS
from canarm_controller.reference.trajectory import built_in_motions, make_trajectory
from canarm_controller.run.state import State
from canarm_emulator.errors import EmulatorError
from canarm_protocol.cell.model import Cell
from canarm_protocol.shown import first_line

from .rig.rig import Rig
from .soundness import unsound, weak_brakes
from .usage import DEFAULT_LAW, UsageError

REHEARSED_S = 3.0
"""The entry into the motion and a second of it: a motion that the robot cannot follow shows by then."""


def rehearse(cell: Cell, laws: Iterable[str] = tuple(LAWS)) -> Iterator[str]:
    """Try `cell` by arithmetic, then with each of `laws`; a line for each thing that works, or that one motion or law
    lacks, or a brake.

    Raises `UsageError` with the reasons, a line each, where it cannot run, or would raise alarms without a fault.
    """
    try:
        problems = list(unsound(cell))
    except ControllerError as error:
        raise UsageError(f"no model of the arm: {error}") from None
    if problems:
        raise UsageError("\n".join(problems))
    yield from weak_brakes(cell)
    fitting = []
    for motion in built_in_motions(cell):
        try:
            make_trajectory(motion, cell)
        except TrajectoryError as error:
            refusal = str(error)
            yield f"motion {refusal}"
        else:
            fitting.append(motion)
    if not fitting:
        raise UsageError(f"no built-in motion fits: {refusal}")
    for law in laws:
        is_default = law == DEFAULT_LAW
        for motion in fitting if is_default else fitting[:1]:
            problem = _trouble(cell, law, motion)
            if problem is None:
                continue
            if is_default:
                raise UsageError(problem)
            yield f"law {law}: {problem}"
    yield f"ran for {REHEARSED_S:g} s with {DEFAULT_LAW} on {' and '.join(fitting)}"


def _trouble(cell: Cell, law: str, motion: str) -> str | None:
    """What goes wrong with a law on a motion without any fault; None if nothing does."""
    try:
        with Rig(cell, law, motion) as rig:
            rig.run(REHEARSED_S)
            stopped = rig.reason if rig.state is not State.RUNNING else None
            found = ", ".join(dict.fromkeys(each.text for each in rig.noticed))
    except LawError as error:
        return f"cannot be used: {error}"
    except (ControllerError, EmulatorError, ArithmeticError, ValueError) as error:
        return f"cannot run: {first_line(error)}"
    if stopped is not None:
        return f"was stopped within {REHEARSED_S:g} s on {motion}: {stopped}"
    if found:
        return f"on {motion}, without any fault, it raised: {found}; canarm check --detectors has the limits"
    return None
