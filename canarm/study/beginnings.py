"""Runs that differ in their faults alone share their beginning: run once in a process, and each goes on from a copy.

As the fault matrix does (decision 20). What a run says does not depend on it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from canarm_controller.run.state import State
from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import CanarmError
from canarm_protocol.faults.script import FaultScript, read_faults
from canarm_protocol.shown import named_error

from ..rig.rig import Rig
from ..summary import Summary
from ..workers.forking import CAN_FORK, in_copy
from .plan import Settings

WORTH = 0.25
"""A beginning that is shorter than that share of a run is not worth a copy."""


class GoneWrongError(CanarmError):
    """What a copy has met."""


@dataclass
class _Kept:
    """The beginning that this process has at hand: of these settings, without faults, after so many cycles."""

    settings: Settings | None = None
    ticks: int = 0
    rig: Rig | None = None


_kept = _Kept()


def from_beginning(settings: Settings, cell: Cell, make: Callable[[Settings], Rig]) -> Summary | None:
    """The summary of a run that goes on from a shared beginning; None where it cannot.

    `cell` is the run's, `make` builds its rig. Raises what it does, and `GoneWrongError`.
    """
    if not CAN_FORK:
        return None
    bare, script = replace(settings, faults=None), None
    if settings.faults is not None:
        script = read_faults(Path(settings.faults))
    is_at_hand = _kept.settings == bare and _kept.rig is not None
    cycle_s = cell.bus.cycle_s
    total = round(settings.seconds / cycle_s)
    onset = total if script is None else _onset(script, cycle_s)
    if not is_at_hand or _kept.ticks > onset:
        if not WORTH * total <= onset < total:
            return None
        _kept.rig = None  # before the next one is made: two of them are twice the memory
        rig = make(bare)
        rig.run(onset * cycle_s)
        _kept.settings, _kept.ticks, _kept.rig = bare, onset, rig
    assert _kept.rig is not None
    if _kept.rig.state is not State.RUNNING:
        return None
    begun, left_s = _kept.rig, (total - _kept.ticks) * cycle_s

    def go_on() -> Summary | str:
        try:
            if settings.faults is not None:
                begun.inject_file(Path(settings.faults))
            begun.run(left_s)
            return begun.finish()
        except CanarmError as error:
            return str(error)
        except Exception as error:
            return named_error(error)

    said = in_copy(go_on)
    if isinstance(said, str):
        raise GoneWrongError(said)
    return said


def _onset(script: FaultScript, cycle_s: float) -> int:
    """The cycle before which no fault of the script begins; 0 if that is not known."""
    sets = script.sets if script.is_parallel else script.sets[:1]
    cycles = []
    for declared in sets:
        trigger = declared.trigger
        if trigger.cycle is not None:
            cycles.append(trigger.cycle)
        elif trigger.at_s is not None:
            cycles.append(int(trigger.at_s / cycle_s))
        else:
            return 0
    return max(min(cycles, default=0) - 1, 0)
