"""The shortest cycle that a cell's traffic and scans fit into. The traffic itself is in the cell's schedule."""

from collections.abc import Callable

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.schedulability import cell_verdict
from canarm_protocol.errors import CellError

from .request import DEFAULT_CYCLE_US, NewCellError, Request

CYCLES_US = (2500, 3000, 4000, 5000, 8000, 10_000, 20_000, 40_000)
"""Tried one after another if none is requested."""
HEARTBEAT_MS = 20
CYCLES_A_HEARTBEAT = 2
USUAL_DELAY_US = 500


def fitting_cycle_us(request: Request, cell_of: Callable[[int], Cell]) -> int:
    """The requested cycle, or the shortest of the usual ones that fits; `cell_of` makes the cell for a cycle.

    Raises `NewCellError` with the arithmetic if the requested one, or every one, does not fit.
    """
    cycles = CYCLES_US if request.cycle_us is None else (request.cycle_us,)
    refusals: list[str] = []
    for cycle_us in cycles:
        problem = _problem(cell_of, cycle_us)
        if problem is None:
            return cycle_us
        refusals.append(problem)
    if request.cycle_us is None:
        try:
            cell_of(CYCLES_US[-1])
        except CellError as error:  # another cycle would not help
            raise NewCellError(str(error)) from None
        raise NewCellError(f"no cycle up to {CYCLES_US[-1]} us fits {request.bitrate} bit/s:\n{refusals[-1]}")
    longer = [each for each in CYCLES_US if each > request.cycle_us and _problem(cell_of, each) is None]
    advice = f"\n--cycle-us {longer[0]} fits" if longer else ""
    raise NewCellError(f"--cycle-us {request.cycle_us} does not fit:\n{refusals[0]}{advice}")


def _problem(cell_of: Callable[[int], Cell], cycle_us: int) -> str | None:
    try:
        verdict = cell_verdict(cell_of(cycle_us))
    except CellError as error:
        return str(error)
    # `canarm check` has each frame's response time; here the question is whether there is room at all.
    telling = (*verdict.lines[:3], *(line for line in verdict.lines if line.startswith("chain")))
    return None if verdict.fits else "\n".join(telling)


def heartbeat_ms(cycle_us: int) -> int:
    """The controller sends its heartbeat in its cycles: at most in every second one."""
    return max(HEARTBEAT_MS, -(-CYCLES_A_HEARTBEAT * cycle_us // 1000))


def compute_delay_us(cycle_us: int) -> int:
    """The controller's compute delay: a fifth of a cycle, as on konkuk1; in short cycles an eighth."""
    return min(USUAL_DELAY_US, cycle_us // (5 if cycle_us >= DEFAULT_CYCLE_US else 8))
