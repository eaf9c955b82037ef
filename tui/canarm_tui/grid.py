"""A table of many rows, drawn line by line: only what is visible is ever put into words.

It knows nothing of what its rows are: a function gives the cells of one, another the key by which it is known again.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

from rich.cells import cell_len, set_cell_size
from rich.segment import Segment
from rich.style import Style
from textual.binding import Binding, BindingType
from textual.events import Click, Resize
from textual.geometry import Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip

from canarm_protocol.shown import printable

from .styles import STYLES, drawn_style
from .texts import Tone, Word

R = TypeVar("R")
GAP = 1
"""Blanks between columns."""
LONGEST_WORD = 400
HEAD = "bold $foreground 60%"


class Column(NamedTuple):
    """A column: its heading, its width in cells (0: what the others leave), and from which width of the table on."""

    title: str
    width: int
    is_right: bool = False
    from_width: int = 0


Cell = Sequence[Word]
"""Words without anything between them."""


class Grid(ScrollView, Generic[R], can_focus=True):
    """Rows with a cursor. With `follows`, it stays at the last row until its reader leaves that."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {"grid--cursor", "grid--chosen"}
    DEFAULT_CSS = """
    Grid { height: 1fr; padding: 0 0 0 1; overflow-x: hidden; }
    Grid .grid--cursor { background: $block-cursor-blurred-background; }
    Grid .grid--chosen { background: $block-cursor-background; color: $block-cursor-foreground; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "move(-1)", "Up", show=False),
        Binding("down", "move(1)", "Down", show=False),
        Binding("pageup", "page(-1)", "Page up", show=False),
        Binding("pagedown", "page(1)", "Page down", show=False),
        Binding("home", "go(0)", "First", show=False),
        Binding("end", "go(-1)", "Last", show=False),
        Binding("enter", "choose", "Open"),
    ]

    class Chosen(Message):
        """The reader has opened `row` of `grid`."""

        def __init__(self, grid: "Grid[Any]", row: Any) -> None:
            super().__init__()
            self.grid, self.row = grid, row

    def __init__(
        self,
        columns: Sequence[Column],
        cells: Callable[[R], Sequence[Cell]],
        key: Callable[[R], Hashable],
        *,
        id: str,
        follows: bool = False,
        empty: str = "",
    ) -> None:
        super().__init__(id=id)
        self.rows: Sequence[R] = ()
        self.cursor = 0
        self.widths: Mapping[str, int] = {}
        """Other widths than those of the columns, by heading."""
        self._columns, self._cells, self._key = columns, cells, key
        self._follows = self._is_at_end = follows
        self.empty = empty
        """What is said where there are no rows."""
        self._styles: dict[str, Style] = {}
        """Of texts, by their description; of what lies under a row, by its component class."""

    def show(self, rows: Sequence[R]) -> None:
        """Show `rows`; the cursor stays with its row as long as that is there."""
        before = self.chosen
        self.rows = rows
        if self._follows and self._is_at_end:
            self.cursor = max(0, len(rows) - 1)
        elif before is not None and not (self.cursor < len(rows) and self._key(rows[self.cursor]) == self._key(before)):
            wanted = self._key(before)
            self.cursor = next((at for at, row in enumerate(rows) if self._key(row) == wanted), self.cursor)
        self.cursor = max(0, min(self.cursor, len(rows) - 1))
        self._fit()
        if self._follows and self._is_at_end:
            self.scroll_to(y=max(0, len(rows) + 1 - self.size.height), animate=False, immediate=True, force=True)
        self.refresh()

    @property
    def chosen(self) -> R | None:
        """The row at the cursor."""
        return self.rows[self.cursor] if self.cursor < len(self.rows) else None

    def on_resize(self, event: Resize) -> None:
        """The width of the rows is that of the widget."""
        self._fit()

    def _fit(self) -> None:
        size = Size(self.scrollable_content_region.width, len(self.rows) + 1)
        if size != self.virtual_size:
            self.virtual_size = size

    def notify_style_update(self) -> None:
        """The theme has changed."""
        super().notify_style_update()
        self._styles.clear()

    def render_line(self, y: int) -> Strip:
        """The heading, or a row."""
        width = self.scrollable_content_region.width
        plain = self._text(STYLES[Tone.PLAIN])
        if y == 0:
            text = self._line([[Word(column.title)] for column in self._columns], width, self._text(HEAD))
            return Strip(text).adjust_cell_length(width, plain)
        at = round(self.scroll_offset.y) + y - 1
        if at >= len(self.rows):
            said = self.empty if not self.rows and y == 1 else ""
            return Strip([Segment(said, self._text(STYLES[Tone.DIM]))]).adjust_cell_length(width, plain)
        strip = Strip(self._line(self._cells(self.rows[at]), width, None)).adjust_cell_length(width, plain)
        if at != self.cursor:
            return strip
        return strip.apply_style(self._under("grid--chosen" if self.has_focus else "grid--cursor"))

    def _line(self, cells: Sequence[Cell], width: int, style: Style | None) -> list[Segment]:
        shown = [
            (column, cell) for column, cell in zip(self._columns, cells, strict=True) if width >= column.from_width
        ]
        fixed = sum(column.width + GAP for column, _ in shown)
        segments: list[Segment] = []
        for column, cell in shown:
            room = column.width or max(0, width - fixed)
            segments += self._fitted(cell, room, column.is_right, style)
            segments.append(Segment(" " * GAP))
        return segments

    def _fitted(self, cell: Cell, room: int, is_right: bool, style: Style | None) -> list[Segment]:
        """The words of a cell in exactly `room` columns, with … where that is not enough."""
        words = [(printable(word.text, LONGEST_WORD), word.tone) for word in cell]
        length = sum(cell_len(text) for text, _ in words)
        segments = [Segment(" " * (room - length))] if is_right and length < room else []
        left = room
        for text, tone in words:
            size = cell_len(text)
            shown = text if size <= left else (f"{set_cell_size(text, left - 1)}…" if left > 0 else "")
            segments.append(Segment(shown, style or self._text(STYLES[tone])))
            left -= cell_len(shown)
            if size > left + cell_len(shown):
                break
        if not is_right and left > 0:
            segments.append(Segment(" " * left))
        return segments

    def _text(self, style: str) -> Style:
        if style not in self._styles:
            self._styles[style] = drawn_style(self, style)
        return self._styles[style]

    def _under(self, name: str) -> Style:
        if name not in self._styles:
            self._styles[name] = self.get_component_rich_style(name, partial=True)
        return self._styles[name]

    def action_move(self, rows: int) -> None:
        """Move the cursor."""
        self.action_go(max(0, min(len(self.rows) - 1, self.cursor + rows)))

    def action_page(self, pages: int) -> None:
        """Move the cursor by what is visible."""
        self.action_move(pages * max(1, self.size.height - 2))

    def action_go(self, at: int) -> None:
        """Put the cursor on a row; -1 is the last one."""
        last = max(0, len(self.rows) - 1)
        self.cursor = last if at < 0 else min(at, last)
        self._is_at_end = self._follows and self.cursor == last
        top, room = round(self.scroll_offset.y), max(1, self.size.height - 1)
        if self.cursor < top:
            self.scroll_to(y=self.cursor, animate=False, immediate=True, force=True)
        elif self.cursor >= top + room:
            self.scroll_to(y=self.cursor - room + 1, animate=False, immediate=True, force=True)
        self.refresh()

    def action_choose(self) -> None:
        """Open the row at the cursor."""
        row = self.chosen
        if row is not None:
            self.post_message(self.Chosen(self, row))

    def on_click(self, event: Click) -> None:
        """A click puts the cursor there, a second one opens the row."""
        at = round(self.scroll_offset.y) + event.y - 1
        if event.y < 1 or at >= len(self.rows):
            return
        was = self.cursor
        self.action_go(at)
        if was == at and event.chain > 1:
            self.action_choose()
