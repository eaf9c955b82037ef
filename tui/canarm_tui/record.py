"""A recorded run as the dashboard is given it: everything that is known of it, as values. No files, no clock."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.model import Cell

from .faults import Faults
from .history import History
from .notices import Notice
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
    frames: Callable[[], Iterator[tuple[int, Frame]]] | None = None
    """The frames of its robot's bus from the beginning, with their times; None where they were not kept."""
    memory: bytes | None = None
    """The Apple II's memory as it was at the end."""
    complaints: tuple[str, ...] = ()
    """What of the record could not be read."""
    noticed: tuple[Notice, ...] = ()
    """The controller's states, oldest first."""
