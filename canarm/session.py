"""Building the parts of a run from names and texts, as the command line and the rig are given them."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.schedulability import cell_verdict
from canarm_protocol.cell.wiring import card_nodes, input_slots
from canarm_protocol.clock import Clock

from .usage import DEFAULT_CELL, DEFAULT_LAW, UsageError, check_number

if TYPE_CHECKING:
    from canarm_controller.run.controller import Controller
    from canarm_emulator.faults.fault_bench import FaultBench

__all__ = [
    "DEFAULT_CELL",
    "DEFAULT_LAW",
    "UsageError",
    "make_bench",
    "make_controller",
    "tick_count",
    "traffic_warning",
]


def make_bench(
    cell: Cell, truth: Mapping[str, str], clock: Clock, seed: int, with_wire: bool = False, option: str = "--truth"
) -> "FaultBench":
    """The emulated bench; errors say that `truth` was given in `option`. Raises `TruthError`.

    The physics engine is loaded only here: a controller starts without it.
    """
    from canarm_emulator.faults.fault_bench import FaultBench
    from canarm_emulator.robot.truth import Truth

    return FaultBench(cell, Truth.from_settings(cell, truth, option), clock, seed, with_wire)


def make_controller(
    cell: Cell,
    law: object,
    trajectory: object,
    feedforward: str | None,
    clock: Clock,
    ticks: int | None = None,
    listen_ns: int = 0,
) -> "Controller":
    """The controller under test; `law` and `trajectory` are what `load_law` and `make_trajectory` take.

    Raises `ControllerError`. The laws are loaded only here: an emulator starts without them.
    """
    from canarm_controller.laws.loading import load_law
    from canarm_controller.reference.trajectory import make_trajectory
    from canarm_controller.run.controller import Controller
    from canarm_controller.run.loop import ControlLoop

    nodes = card_nodes(cell)
    slots = input_slots(cell, nodes)
    loop = ControlLoop(cell, slots, load_law(law), make_trajectory(trajectory, cell), feedforward)
    return Controller(cell, nodes, slots, loop, clock, ticks, listen_ns)


def tick_count(cell: Cell, seconds: float, source: str = "--seconds") -> int:
    """The number of cycles in `seconds`, given in `source`. Raises `UsageError` for less than one, or no number."""
    given: object = seconds
    if not (isinstance(given, float) and math.isnan(given)):  # which is told as what is too short
        check_number(source, seconds)
    ticks = round(float(seconds) / cell.bus.cycle_s) if math.isfinite(seconds) else 0
    if ticks < 1:
        raise UsageError(f"{source} {seconds:g}: must be at least one cycle, {cell.bus.cycle_s:g} s")
    return ticks


def traffic_warning(cell: Cell, name: str) -> str | None:
    """The warning before a run of a cell whose cyclic traffic exceeds its bit rate; `name` is its name or file."""
    if cell_verdict(cell).fits:
        return None
    return (
        f"{name}: the cyclic traffic does not fit {cell.bus.bitrate} bit/s and a cycle of {cell.bus.cycle_us} us; on a "
        f"real bus frames come late: canarm check --cell {name} has the arithmetic"
    )
