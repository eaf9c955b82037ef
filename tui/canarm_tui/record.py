"""A recorded run as the dashboard is given it: everything that is known of it, as values. No files, no clock."""

from dataclasses import dataclass, field

from canarm_protocol.cell.model import Cell

from .faults import Faults
from .history import History
from .outcome import Outcome


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """A run of `cell`. `history` has all rows, with references and errors; `faults` all events of it."""

    cell: Cell
    where: str
    """Where it is recorded."""
    history: History
    faults: Faults = field(default_factory=Faults)
    outcome: Outcome | None = None
    """How it ended, if that is known."""
    law: str = ""
    internal_names: tuple[str, ...] = ()
