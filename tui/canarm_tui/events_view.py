"""The view of events: what the bench remembers and the buses have told, newest first, to filter, and to jump from to
the traces.
"""

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.widgets import Input, OptionList
from textual.widgets.option_list import Option

from .bus.node_events import NodeEvents
from .bus.watch import BusWatch
from .event_texts import NOTHING, Line, event_line
from .events import Happening
from .player import Player
from .styles import line_of
from .texts import Tone, Word
from .views import Context, Pane, Scene, View

NONE_FITS = (Word("none of the events has all of these words; escape shows all again", Tone.DIM),)


class EventsPane(Pane):
    """A list that is filled only when it changes; an older event that the reader has chosen stays chosen."""

    class Jump(Message):
        """The reader wants to see the traces at a cycle."""

        def __init__(self, chosen: Happening) -> None:
            super().__init__()
            self.cycle, self.is_earlier = chosen.event.cycle, chosen.is_earlier
            self.which = f"run-{chosen.run}" if chosen.run else "that run"

    DEFAULT_CSS = """
    EventsPane Input { display: none; }
    EventsPane.-filtered Input { display: block; }
    EventsPane OptionList, EventsPane OptionList:focus {
        height: 1fr; border: none; padding: 0 1; text-wrap: nowrap; text-overflow: ellipsis;
    }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(
            "slash", "filter", "Filter", key_display="/", id="events.filter", tooltip="Words that all must be in it"
        ),
        Binding("escape", "unfilter", "All", id="events.all", show=False),
    ]

    def __init__(self, cycle_s: float, bus: BusWatch) -> None:
        super().__init__()
        self._cycle_s, self.bus = cycle_s, bus
        self._happened: tuple[Happening, ...] = ()
        self._fitting: tuple[Happening, ...] = ()
        self.lines: tuple[Line, ...] = ()

    def compose(self) -> ComposeResult:
        """The filter, and the list."""
        yield Input(placeholder="words, such as: joint2 detected", compact=True)
        yield OptionList(id="events")

    def chosen(self) -> None:
        """Somebody looks: the robot's bus is opened. The keyboard goes to the list."""
        self.bus.wake()
        self.query_one(OptionList).focus()

    def show(self, scene: Scene) -> None:
        """Show what has happened."""
        if scene.happened is not self._happened or not self.lines:
            self._happened = scene.happened
            self._fill()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Filter while typing."""
        self._fill()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """On to the list."""
        self.query_one(OptionList).focus()

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Enter or a click: the traces at that moment."""
        if self._fitting:
            self.post_message(self.Jump(self._fitting[event.option_index]))

    def action_filter(self) -> None:
        """Type words."""
        self.set_class(True, "-filtered")
        self.query_one(Input).focus()

    def action_unfilter(self) -> None:
        """All of them again."""
        self.set_class(False, "-filtered")
        self.query_one(Input).value = ""
        self.query_one(OptionList).focus()

    def _fill(self) -> None:
        options, words = self.query_one(OptionList), self.query_one(Input).value.casefold().split()
        place = options.highlighted
        # The newest stays chosen until its reader leaves it.
        chosen = self._fitting[place] if place and place < len(self._fitting) else None
        lines = [(each, event_line(each, self._cycle_s)) for each in self._happened]
        fitting = [(each, line) for each, line in lines if _fits(line, words)]
        self._fitting = tuple(each for each, _ in fitting)
        self.lines = tuple(line for _, line in fitting) or ((NONE_FITS if self._happened else NOTHING),)
        options.clear_options()
        options.add_options([Option(line_of(line)) for line in self.lines])
        options.highlighted = self._fitting.index(chosen) if chosen in self._fitting else 0


def _fits(line: Line, words: list[str]) -> bool:
    text = " ".join(word.text for word in line).casefold()
    return all(word in text for word in words)


def _make(context: Context) -> EventsPane:
    feed = context.feed
    # A recorded bus is heard from its beginning, wherever the record is by then.
    heard = NodeEvents(context.bus.book, lambda: None if isinstance(feed, Player) else feed.cycle)
    context.bus.listeners.append(heard)
    context.notices.append(heard.notices)
    return EventsPane(context.cell.bus.cycle_s, context.bus)


VIEW: View[Context] = View(
    name="events",
    title="Events",
    key="2",
    what="Faults, detections, EMCY, NMT, states, missed cycles, newest first",
    make=_make,
    help="""\
All that the bench remembers, newest first; ↑ ↓ choose, enter shows the traces at that moment.
/  filter by words, such as joint2 detected     escape  all of them again
Times count from cycle 0 of the run; what was before the present one says of which it is. Of a detection: how
long after the last fault, or emergency stop, that acts or has just ended, and what the controller did.
▲ ○  fault begins, ends     ◆  detected     ■ □  emergency stop on, off     ▸  state of the controller
!  EMCY     »  NMT command     •  state of a node     ×  cycles missed or late
EMCY, NMT and nodes are heard on the robot's bus: from the beginning, on a busy one from when a view first looks.""",
)
