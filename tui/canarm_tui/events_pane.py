"""The pane of events: a scrolling list of all that the bench remembers, newest first. Draws what it is given."""

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Static

from .event_texts import Line
from .styles import line_of


class EventsPane(VerticalScroll):
    """Lines that are redrawn only when they change; where the reader has scrolled to stays."""

    DEFAULT_CSS = """
    EventsPane { padding: 0 1; }
    EventsPane Static { height: auto; }
    """

    def __init__(self) -> None:
        super().__init__(id="pane-events")
        self.lines: tuple[Line, ...] = ()

    def compose(self) -> ComposeResult:
        """One text of many lines."""
        yield Static(id="events")

    def show(self, lines: tuple[Line, ...]) -> None:
        """Show `lines`."""
        if lines != self.lines:
            self.lines = lines
            self.query_one(Static).update(Content("\n").join(line_of(words) for words in lines))
