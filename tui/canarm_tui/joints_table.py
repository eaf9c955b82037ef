"""The table of joints: a row each, with as many columns as the terminal has room for. Draws what it is given."""

from collections.abc import Sequence
from typing import ClassVar

from rich.text import Text
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.coordinate import Coordinate
from textual.events import Resize
from textual.widgets import DataTable

from canarm_protocol.shown import printable

from .joint_texts import JointColumn, columns_for, joint_words
from .snapshot import JointNow
from .styles import STYLES
from .texts import Word

LONGEST_NAME = 24
LONGEST_TITLE = 13


class JointsTable(DataTable[Content], inherit_bindings=False):
    """A row per joint; only cells whose text changed are written. Arrows to the left and right belong to the traces."""

    DEFAULT_CSS = "JointsTable { height: auto; max-height: 50%; padding: 0 0 0 1; }"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "cursor_up", "Joint above", show=False, id="joints.up"),
        Binding("down", "cursor_down", "Joint below", show=False, id="joints.down"),
    ]

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(cursor_type="row", cell_padding=0, id="joints")
        self._names = [printable(name, LONGEST_NAME) for name in names]
        self._layout: tuple[JointColumn, ...] = ()
        self._inner, self._inner_name = 0, ""
        self._shown: list[tuple[Word, ...]] = []
        self._joints: Sequence[JointNow] = [JointNow()] * len(names)

    def on_mount(self) -> None:
        """Set up columns and rows."""
        self._build(columns_for(self.app.size.width))

    def on_resize(self, event: Resize) -> None:
        """Other columns have room."""
        columns = columns_for(self.app.size.width)
        if columns != self._layout:
            self._build(columns)

    def show(self, joints: Sequence[JointNow], inner: int, inner_name: str) -> None:
        """Show the state of the joints, and of the law's own values the one of that place and name."""
        self._joints = joints
        if (inner, inner_name) != (self._inner, self._inner_name):
            self._inner, self._inner_name = inner, inner_name
            self._build(self._layout)
            return
        for row, joint in enumerate(joints):
            words = joint_words(joint, self._layout, inner)
            for column, (word, before) in enumerate(zip(words, self._shown[row], strict=True)):
                if word != before:
                    self.update_cell_at(Coordinate(row, column + 1), self._cell(column, word))
            self._shown[row] = words

    def _build(self, columns: tuple[JointColumn, ...]) -> None:
        row, self._layout = self.cursor_row, columns
        self.clear(columns=True)
        self.add_column("joint", width=max(len("joint"), *map(len, self._names)))
        for column in columns:
            title = column.title or printable(self._inner_name, LONGEST_TITLE)
            self.add_column(Text(title.rjust(column.width)), width=column.width)
        self._shown = [joint_words(joint, columns, self._inner) for joint in self._joints]
        for name, words in zip(self._names, self._shown, strict=True):
            self.add_row(Content(name), *(self._cell(place, word) for place, word in enumerate(words)))
        self.move_cursor(row=row, animate=False)

    def _cell(self, column: int, word: Word) -> Content:
        return Content.styled(printable(word.text).rjust(self._layout[column].width), STYLES[word.tone])
