"""The view of events: a scrolling list of all that the bench remembers, newest first."""

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Static

from .event_texts import Line, event_lines
from .styles import line_of
from .views import Context, Pane, Scene, View


class EventsPane(Pane):
    """Lines that are redrawn only when they change; where the reader has scrolled to stays."""

    DEFAULT_CSS = """
    EventsPane { padding: 0 1; }
    EventsPane Static { height: auto; }
    """

    def __init__(self, cycle_s: float) -> None:
        super().__init__()
        self._cycle_s = cycle_s
        self.lines: tuple[Line, ...] = ()

    def compose(self) -> ComposeResult:
        """One text of many lines."""
        with VerticalScroll():
            yield Static(id="events")

    def show(self, scene: Scene) -> None:
        """Show what has happened."""
        lines = event_lines(scene.happened, self._cycle_s)
        if lines != self.lines:
            self.lines = lines
            self.query_one(Static).update(Content("\n").join(line_of(words) for words in lines))


VIEW: View[Context] = View(
    name="events",
    title="Events",
    key="2",
    what="Faults and detections, newest first",
    make=lambda context: EventsPane(context.cell.bus.cycle_s),
    help="""\
All that the bench remembers, newest first; the arrows scroll.
Of a detection: how long after the last fault, and what the controller did.""",
)
