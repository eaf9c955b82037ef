"""The view of frames: a line for each identifier and, where there is room, the last frames as they came beside it."""

from collections.abc import Callable, Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container
from textual.events import Resize
from textual.widgets import Input

from canarm_protocol.decoding import Meaning

from ..grid import Column, Grid
from ..link import LinkState
from ..texts import Tone, Word
from ..views import Context, Pane, Scene, View
from ..widgets import WordLine
from .bus_texts import data_words, figure_words, identifier_text, meaning_words, row_cells, state_words
from .filtering import HOW, FrameFilter
from .frame_screen import FrameScreen
from .rows import Key, RowNow
from .store import BusNow, Heard
from .watch import BusWatch

BESIDE_FROM_COLUMNS = 150
BELOW_FROM_LINES = 14
"""The log is beside the table from so many columns on, else below it from so many lines on."""
ORDERS: dict[str, Callable[[RowNow], object]] = {
    "identifier": lambda row: row.key,
    "rate": lambda row: (-row.rate_hz, row.key),
    "newest": lambda row: (-row.wall_ns, row.key),
}
"""By which the rows can be put in order."""
COLUMNS = (
    Column("ID", 8),
    Column("count", 8, is_right=True, from_width=90),
    Column("1/s", 5, is_right=True),
    Column("ms", 8, is_right=True, from_width=76),
    Column("data", 23),
    Column("meaning", 0),
)
LOG_COLUMNS = (Column("s", 12, is_right=True), Column("ID", 8), Column("data", 23), Column("meaning", 0))
NOTHING_YET, NOTHING_FITS = "no frame was heard yet", "nothing fits the filter"
READING, NOTHING_UP_TO_HERE = "the log is being read …", "no frame was recorded up to here"
SHORT_ID = 5
"""Columns of an identifier while none has 29 bits."""


class FramesPane(Pane):
    """Frames of one bus. It opens its bus when it is first chosen."""

    DEFAULT_CSS = """
    FramesPane #bus-state { display: none; height: auto; max-height: 3; text-wrap: wrap; }
    FramesPane #bus-state.-shown { display: block; }
    FramesPane #frame-tables { height: 1fr; layout: vertical; }
    FramesPane #frames { max-height: 100%; }
    FramesPane #frame-log { display: none; border-top: hkey $foreground 30%; }
    FramesPane.-below #frames { max-height: 60%; }
    FramesPane.-below #frame-log { display: block; }
    FramesPane.-beside #frame-tables { layout: horizontal; }
    FramesPane.-beside #frames { width: 5fr; height: 1fr !important; max-height: 100%; }
    FramesPane.-beside #frame-log {
        display: block; width: 4fr; height: 1fr; border-top: none; border-left: vkey $foreground 30%;
    }
    FramesPane Input { display: none; height: 1; border: none; padding: 0 1; }
    FramesPane Input.-shown { display: block; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("slash", "filter", "Filter", key_display="/", id="bus.filter", tooltip=HOW),
        Binding("o", "order", "Order", id="bus.order", tooltip="By identifier, by rate, or the newest first"),
        Binding("c", "clear_counts", "Recount", id="bus.clear", tooltip="Count anew"),
        Binding("escape", "unfilter", "No filter", show=False),
    ]

    def __init__(self, watch: BusWatch) -> None:
        super().__init__()
        self.bus = watch
        self.filter_text = ""
        self.order = next(iter(ORDERS))
        self._filter = FrameFilter()
        self._now: BusNow | None = None
        self._wall_ns = 0
        self._meanings: dict[Key, tuple[RowNow, Meaning]] = {}

    def compose(self) -> ComposeResult:
        """Figures, tables, filter."""
        yield WordLine(id="bus-state", may_wrap=True)
        yield WordLine(id="bus-figures")
        with Container(id="frame-tables"):
            yield Grid[RowNow](COLUMNS, self._row, lambda row: row.key, id="frames")
            yield Grid[Heard](LOG_COLUMNS, self._logged, id, id="frame-log", follows=True)
        yield Input(placeholder=HOW, id="bus-filter", compact=True)

    def on_resize(self, event: Resize) -> None:
        """The log goes where it would leave too little."""
        is_beside = event.size.width >= BESIDE_FROM_COLUMNS
        self.set_class(is_beside, "-beside")
        self.set_class(not is_beside and event.size.height >= BELOW_FROM_LINES, "-below")

    def chosen(self) -> None:
        """Somebody looks: the bus is opened."""
        self.bus.wake()
        self.query_one("#frames").focus()

    def show(self, scene: Scene) -> None:
        """Show the bus as it is now."""
        now = self.bus.now(scene.now_ns)
        self._now, self._wall_ns = now, scene.now_ns
        self.query_one("#frames", Grid).empty = self._why_empty(bool(self._filter.terms and now.rows))
        rows: Sequence[RowNow] = sorted(now.rows, key=ORDERS[self.order])  # type: ignore[arg-type]
        log: Sequence[Heard] = now.log
        if self._filter.terms:
            rows = [row for row in rows if self._filter.fits(row.frame, self._meaning(row))]
            kept = {row.key for row in rows}
            log = [each for each in log if (each.frame[0], each.frame[2], each.frame[3]) in kept]
        state = state_words(self.bus.link, now, scene.now_ns, self.bus.is_behind)
        is_lost = self.bus.link.state is LinkState.LOST
        # What is wrong may take several lines; that all is well, a word.
        self.query_one("#bus-state", WordLine).set_class(is_lost, "-shown")
        self.query_one("#bus-state", WordLine).show(state if is_lost else ())
        figures = figure_words(now, self.bus.link, len(rows), self.filter_text)
        words = (*(() if is_lost else state), *self._order_words(), *figures)
        self.query_one("#bus-figures", WordLine).show(words)
        self._show_tables(rows, log, any(row.frame.is_extended for row in now.rows))

    def _show_tables(self, rows: Sequence[RowNow], log: Sequence[Heard], is_wide: bool) -> None:
        frames, logged = self.query_one("#frames", Grid), self.query_one("#frame-log", Grid)
        for grid in (frames, logged):
            grid.widths = {} if is_wide else {"ID": SHORT_ID}
        if self.has_class("-below"):
            frames.styles.height = max(2, len(rows) + 1)
        else:
            frames.styles.height = "1fr"
        frames.show(rows)
        if logged.display:
            logged.show(log)

    def _why_empty(self, is_filtered: bool) -> str:
        if is_filtered:
            return NOTHING_FITS
        if self.bus.is_behind:
            return READING
        return NOTHING_YET if self.bus.link.is_live else NOTHING_UP_TO_HERE

    def _order_words(self) -> tuple[Word, ...]:
        return () if self.order == next(iter(ORDERS)) else (Word(f"by {self.order}", Tone.DIM),)

    def _row(self, row: RowNow) -> Sequence[Sequence[Word]]:
        return row_cells(row, self._meaning(row), self._wall_ns)

    def _logged(self, heard: Heard) -> Sequence[Sequence[Word]]:
        meaning = self.bus.decoder.meaning(heard.frame, heard.about)
        return (
            (Word(f"{heard.time_ns * 1e-9:.6f}"[-12:], Tone.DIM),),
            (Word(identifier_text(heard.frame)),),
            data_words(heard.frame, 0, is_fresh=False),
            meaning_words(meaning),
        )

    def _meaning(self, row: RowNow) -> Meaning:
        """Worked out once for each frame that is looked at."""
        known = self._meanings.get(row.key)
        if known is not None and known[0].frame is row.frame:
            return known[1]
        meaning = self.bus.decoder.meaning(row.frame, row.about)
        self._meanings[row.key] = row, meaning
        return meaning

    def on_grid_chosen(self, event: Grid.Chosen) -> None:
        """A frame is opened."""
        event.stop()
        row: RowNow | Heard = event.row
        frame = row.frame
        self.app.push_screen(FrameScreen(self.bus, (frame.can_id, frame.is_extended, frame.is_remote), row))

    def action_filter(self) -> None:
        """Ask for the filter, which acts while it is typed."""
        field = self.query_one("#bus-filter", Input)
        field.add_class("-shown")
        field.focus()

    def action_unfilter(self) -> None:
        """All frames again."""
        field = self.query_one("#bus-filter", Input)
        field.value = ""
        field.remove_class("-shown")
        self.query_one("#frames").focus()

    def filter(self, text: str) -> None:
        """Only what fits `text` from now on."""
        self.query_one("#bus-filter", Input).value = text
        self.filter_text, self._filter = text.strip(), FrameFilter.parse(text)

    def on_input_changed(self, event: Input.Changed) -> None:
        """The filter acts at once."""
        event.stop()
        self.filter_text, self._filter = event.value.strip(), FrameFilter.parse(event.value)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """The filter stays; the keys belong to the table again."""
        event.stop()
        event.input.remove_class("-shown")
        self.query_one("#frames").focus()

    def action_order(self) -> None:
        """The next order of the rows."""
        names = list(ORDERS)
        self.order = names[(names.index(self.order) + 1) % len(names)]

    def action_clear_counts(self) -> None:
        """Count anew."""
        self.bus.store.clear()
        self._meanings.clear()


HELP = """\
One line for each identifier: how many frames, how many a second, their period in ms, the newest data, what they mean.
Underlined bytes have changed within the last second. ▲ is what breaks a protocol, or reports that something is wrong.
/ filters: 294 or 200-2ff (identifiers), adc, sdo, tpdo2; several words must all fit, and -sync leaves out
o orders by identifier, by rate, or the newest first; c counts anew; enter opens a frame down to its bits
Rates and load are those of the bus's own clock. Load is counted with stuff bits, against the cell's bit rate.
Beside the table, or below it, are the last 2000 frames: tab goes there, the arrows leave its end and go back."""

VIEW: View[Context] = View(
    name="bus",
    title="Bus",
    key="3",
    what="Frames of the robot's bus, decoded",
    make=lambda context: FramesPane(context.bus),
    help=HELP,
)
