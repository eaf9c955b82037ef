"""What a view of the dashboard is: a descriptor, the widget that it makes, and what that is given to draw.

The views themselves are a file each, listed in `view_registry`; keys, tabs, palette and help are made from that list.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from textual.containers import Vertical

from canarm_protocol.cell.model import Cell

from .bus.hand import Hand
from .bus.watch import BusWatch
from .events import Happening
from .fault_desk import FaultDesk
from .faults import Faults
from .feed import Feed
from .notices import Noticing
from .player import Player
from .snapshot import Snapshot


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One picture of the run, the same for all views: what the telemetry says, and what has happened."""

    snapshot: Snapshot
    happened: tuple[Happening, ...] = ()
    faults: Faults | None = None
    """As last read from the bench; None before."""
    now_ns: int = 0
    """Wall time of the picture."""


class Source(Protocol):
    """Something other than the bench bus that is to be drained as often as it."""

    @property
    def changes(self) -> object:
        """Is another one as soon as there is something new to draw."""

    def poll(self, now_ns: int) -> None:
        """Take what has arrived, without waiting. Raises nothing."""

    def close(self) -> None:
        """Called once, when the dashboard ends."""


@dataclass(frozen=True, slots=True)
class Context:
    """What a view may keep from the beginning: the cell, the memory of the run, further sources."""

    cell: Cell
    feed: Feed | Player
    bus: BusWatch
    """The robot's bus; one of `sources`."""
    sources: list[Source] = field(default_factory=list)
    """A view adds its own here when it is made; it takes what has arrived when it is asked to `show`."""
    notices: list[Noticing] = field(default_factory=list)
    """What is to be listed among the events; a view that listens to a bus adds its own."""
    desk: FaultDesk | None = None
    """Asks the bench node; None where there is none."""
    hand: Hand | None = None
    """Drives the cards by hand; None where a controller of this program has them."""
    memory: bytes | None = None
    """The Apple II's memory as a recorded run left it."""


class Pane(Vertical):
    """The widget of a view. `show` is called a few times a second while it is visible and not paused, else not."""

    def show(self, scene: Scene) -> None:
        """Draw `scene`."""
        raise NotImplementedError

    def chosen(self) -> None:
        """It is on the screen from now on: the keyboard goes to the first part of it that takes keys."""
        for widget in self.query("*"):
            if widget.focusable and widget.display:
                widget.focus()
                return
        self.screen.set_focus(None)


C = TypeVar("C")
"""What a program gives the views that it makes: the dashboard a `Context`, the monitor its bus."""


@dataclass(frozen=True, slots=True)
class View(Generic[C]):
    """A view: one file with one of these, one line in `VIEWS`."""

    name: str
    """Of the action and, as "pane-NAME", of the widget."""
    title: str
    """One short word, for tabs and keys."""
    key: str
    what: str
    """One line, for the palette and tooltips."""
    make: Callable[[C], Pane]
    help: str = ""
    """Lines for the help screen, in textual's markup."""

    @property
    def pane_id(self) -> str:
        """The widget's id."""
        return f"pane-{self.name}"
