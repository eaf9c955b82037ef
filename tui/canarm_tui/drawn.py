"""A widget that is drawn as a whole and redrawn row by row: only rows that have changed go to the terminal.

Every frame asks each widget that is in sight for all its rows, changed or not. These widgets hand out what is ready:
textual's way, which looks at borders, padding and filters row by row, costs a twelfth of the dashboard's computing.

What is drawn is the business of those that derive from it.
"""

from collections.abc import Sequence
from typing import Any

from rich.style import Style
from textual.events import Resize
from textual.filter import LineFilter
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from .styles import drawn_style


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

    def described(self, style: str) -> Style:
        """A style by its description, as in `STYLES`."""
        if style not in self._styles_by_name:
            self._styles_by_name[style] = drawn_style(self, style)
        return self._styles_by_name[style]

    def notify_style_update(self) -> None:
        """The colours have changed."""
        super().notify_style_update()
        self._styles_by_name.clear()


class Drawn(Drawing):
    """Calls `draw` after `redraw`, and when size or colours change."""

    def __init__(self, id: str) -> None:
        super().__init__(id=id)
        self._strips: list[Strip] = []
        self._shown: list[Strip] = []
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
        drawn = self._whole(size)
        changed = [row for row in range(size[1]) if drawn[row] != self._strips[row]]
        if not changed:
            return
        filters = self.get_line_filters()
        for row in changed:
            self._strips[row] = drawn[row]
            self._shown[row] = self._filtered(drawn[row], filters)
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
        self._make_ready()
        return self._strips[y]

    def render_lines(self, crop: Region) -> list[Strip]:
        """The rows of `crop`."""
        if self.size != self.outer_size or self.opacity < 1.0:
            return super().render_lines(crop)
        self._make_ready()
        rows = self._shown[crop.y : crop.bottom]
        return rows if crop.width == self.size.width else [row.crop(crop.x, crop.right) for row in rows]

    def _make_ready(self) -> None:
        size = self.size.width, self.size.height
        if size != self._strips_size:
            self._strips_size, self._strips = size, self._whole(size)
            filters = self.get_line_filters()
            self._shown = [self._filtered(strip, filters) for strip in self._strips]

    def _whole(self, size: tuple[int, int]) -> list[Strip]:
        width, height = size
        drawn = self.draw(width, height)[:height]
        drawn += [Strip.blank(width, self.rich_style)] * (height - len(drawn))
        return drawn

    def _filtered(self, strip: Strip, filters: Sequence[LineFilter]) -> Strip:
        background = self.background_colors[1]
        strip = strip.adjust_cell_length(self.size.width, Style.from_color(bgcolor=background.rich_color))
        for each in filters:
            strip = strip.apply_filter(each, background)
        return strip
