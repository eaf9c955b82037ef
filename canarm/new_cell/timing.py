"""The shortest cycle that a cell's traffic and scans fit into. The traffic itself is in the cell's schedule."""

from collections.abc import Callable

from canarm_protocol.cell.model import LONGEST_CYCLE_US, SHORTEST_CYCLE_US, Cell
from canarm_protocol.cell.schedulability import cell_verdict
from canarm_protocol.errors import CellError

from .request import DEFAULT_CYCLE_US, NewCellError, Request

CYCLES_US = (2500, 3000, 4000, 5000, 8000, 10_000, 20_000, 40_000)
"""Tried one after another if none is requested."""
ADVICE_STEP_US = 100
HEARTBEAT_MS = 20
CYCLES_A_HEARTBEAT = 2
USUAL_DELAY_US = 500


def fitting_cycle_us(request: Request, cell_of: Callable[[int], Cell]) -> int:
    """The requested cycle, or the shortest of the usual ones that fits; `cell_of` makes the cell for a cycle.

    Raises `NewCellError` with the arithmetic if the requested one, or every one, does not fit.
    """
    if request.cycle_us is not None and not SHORTEST_CYCLE_US <= request.cycle_us <= LONGEST_CYCLE_US:
        shortest = _shortest_fitting(cell_of, max(request.cycle_us, 0))
        advice = "" if shortest is None else f"; --cycle-us {shortest} fits"
        raise NewCellError(
            f"--cycle-us {request.cycle_us}: must be {SHORTEST_CYCLE_US} to {LONGEST_CYCLE_US} us{advice}"
        )
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
    shortest = _shortest_fitting(cell_of, request.cycle_us)
    advice = "" if shortest is None else f"\n--cycle-us {shortest} fits"
    raise NewCellError(f"--cycle-us {request.cycle_us} does not fit:\n{refusals[0]}{advice}")


def _shortest_fitting(cell_of: Callable[[int], Cell], refused_us: int) -> int | None:
    """The shortest cycle in whole `ADVICE_STEP_US` that fits where `refused_us` does not; None up to 40 ms."""
    usual = next((each for each in CYCLES_US if each > refused_us and _problem(cell_of, each) is None), None)
    if usual is None:
        return None
    fitting = -(-usual // ADVICE_STEP_US)
    refused = refused_us // ADVICE_STEP_US
    while fitting - refused > 1:
        middle = (fitting + refused) // 2
        if _problem(cell_of, middle * ADVICE_STEP_US) is None:
            fitting = middle
        else:
            refused = middle
    return fitting * ADVICE_STEP_US


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
