"""The view of the joints: their values in a table, and below it their errors over time."""

from collections.abc import Sequence

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.content import Content
from textual.coordinate import Coordinate
from textual.events import Resize
from textual.widgets import DataTable

from canarm_protocol.cell.model import Cell
from canarm_protocol.shown import printable

from . import texts
from .event_texts import marks_of
from .events import Happening
from .snapshot import Counters, JointNow
from .styles import STYLES
from .texts import Word
from .trace import ErrorTrace
from .views import Pane, Scene, View

TRACES_FROM_COLUMNS = 100
SHARING_TRACES = 3
"""Up to this many traces share the space; more have a fixed height and scroll."""


class JointsTable(DataTable[Content]):
    """A row per joint; only cells whose text changed are written."""

    DEFAULT_CSS = "JointsTable { height: auto; max-height: 60%; padding: 0 0 0 1; }"

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(cursor_type="row", cell_padding=0, id="joints")
        self._names = names
        self._widths = [width or max(map(len, (title, *names))) for title, width in texts.JOINT_COLUMNS]
        self._shown: list[tuple[Word, ...]] = []

    def on_mount(self) -> None:
        """Set up columns and rows."""
        for column, (title, _) in enumerate(texts.JOINT_COLUMNS):
            self.add_column(self._aligned(column, title), width=self._widths[column])
        for name in self._names:
            words = texts.joint_words(name, JointNow())
            self._shown.append(words)
            self.add_row(*(self._cell(column, word) for column, word in enumerate(words)))

    def show(self, joints: Sequence[JointNow]) -> None:
        """Show the state of the joints."""
        for row, (name, joint) in enumerate(zip(self._names, joints, strict=True)):
            words = texts.joint_words(name, joint)
            for column, (word, before) in enumerate(zip(words, self._shown[row], strict=True)):
                if word != before:
                    self.update_cell_at(Coordinate(row, column), self._cell(column, word))
            self._shown[row] = words

    def _cell(self, column: int, word: Word) -> Content:
        return Content.styled(self._aligned(column, printable(word.text)), STYLES[word.tone])

    def _aligned(self, column: int, text: str) -> str:
        """Numbers right-aligned; text, in the first and last column, left-aligned."""
        return text if column in (0, len(self._widths) - 1) else text.rjust(self._widths[column])


class JointsPane(Pane):
    """The joints' values, and below them their errors over time."""

    DEFAULT_CSS = """
    JointsPane #traces { height: 1fr; }
    JointsPane.-many ErrorTrace { height: 8; }
    JointsPane.-narrow #traces { display: none; }
    JointsPane.-narrow JointsTable { max-height: 100%; }
    """

    def __init__(self, cell: Cell) -> None:
        super().__init__(classes="-many" if len(cell.joint_names) > SHARING_TRACES else None)
        self._names = cell.joint_names
        self._shown: tuple[Counters, tuple[Happening, ...]] | None = None

    def compose(self) -> ComposeResult:
        """The table and the traces."""
        yield JointsTable(self._names)
        with VerticalScroll(id="traces", can_focus=False):
            for joint, name in enumerate(self._names):
                yield ErrorTrace(name, joint)

    def on_resize(self, event: Resize) -> None:
        """Below `TRACES_FROM_COLUMNS` the table takes all the space."""
        self.set_class(event.size.width < TRACES_FROM_COLUMNS, "-narrow")

    def on_data_table_row_highlighted(self, event: DataTable.RowHighlighted) -> None:
        """Scroll to the trace of the joint at the cursor."""
        self.query(ErrorTrace)[event.cursor_row].scroll_visible(animate=False)

    def show(self, scene: Scene) -> None:
        """Show `scene`, unless nothing has come since the last time."""
        snapshot, happened = scene.snapshot, scene.happened
        if (snapshot.counters, happened) == self._shown:
            return
        self._shown = snapshot.counters, happened
        self.query_one(JointsTable).show(snapshot.joints)
        for name, trace in zip(self._names, self.query(ErrorTrace), strict=True):
            trace.show(snapshot, marks_of(happened, name, self._names))


VIEW = View(
    name="joints",
    title="Joints",
    key="1",
    what="The joints and their errors",
    make=lambda context: JointsPane(context.cell),
    help="""\
Angle, reference and error belong to the same cycle: the newest whose reference has arrived.
While no cycles come, the angle is the present one, without reference and error.
Error          true angle minus reference, in steps (LSB) of the joint's position sensor
RMS            of the error over the last 10 s of the run, as are the traces
saturated +/−  the amplifier is at its limit, in that direction
▲ ◆ ○          above a trace: a fault began, a detector answered, a fault ended; of this joint, or of none
The traces need a terminal of 100 columns.""",
)
