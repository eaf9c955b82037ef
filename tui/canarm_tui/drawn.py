"""A widget that is drawn as a whole and redrawn row by row: only rows that have changed go to the terminal.

What is drawn is the business of those that derive from it.
"""

from typing import Any

from rich.style import Style
from textual.events import Resize
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget


class Drawing(Widget):
    """Looks up the styles of its component classes once each: that costs more than drawing a row."""

    def __init__(self, *children: Widget, **options: Any) -> None:
        super().__init__(*children, **options)
        self._styles_by_name: dict[str, Style] = {}

    def style_of(self, name: str) -> Style:
        """The style of a component class."""
        if name not in self._styles_by_name:
            self._styles_by_name[name] = self.get_component_rich_style(name)
        return self._styles_by_name[name]

    def notify_style_update(self) -> None:
        """The colours have changed."""
        super().notify_style_update()
        self._styles_by_name.clear()


class Drawn(Drawing):
    """Calls `draw` after `redraw`, and when size or colours change."""

    def __init__(self, id: str) -> None:
        super().__init__(id=id)
        self._strips: list[Strip] = []
        self._strips_size = (0, 0)

    def draw(self, width: int, height: int) -> list[Strip]:
        """All rows, from the top."""
        raise NotImplementedError

    def redraw(self) -> None:
        """Draw anew what has changed."""
        size = self.size.width, self.size.height
        if not all(size) or size != self._strips_size:
            self._strips_size = (0, 0)
            self.refresh()
            return
        before, self._strips = self._strips, self.draw(*size)
        rows = max(len(before), len(self._strips))
        changed = [row for row in range(rows) if before[row : row + 1] != self._strips[row : row + 1]]
        if changed:
            self.refresh(*(Region(0, row, size[0], 1) for row in changed))

    def on_resize(self, event: Resize) -> None:
        """Everything is elsewhere."""
        self._strips_size = (0, 0)

    def notify_style_update(self) -> None:
        """The colours have changed: discard everything drawn before."""
        super().notify_style_update()
        self._strips_size = (0, 0)

    def render_line(self, y: int) -> Strip:
        """One row of the widget; all are drawn together."""
        size = self.size.width, self.size.height
        if size != self._strips_size:
            self._strips_size, self._strips = size, self.draw(*size)
        return self._strips[y] if y < len(self._strips) else Strip.blank(size[0], self.rich_style)
