"""The line that names the views and their keys, and says which one is on the screen. A click chooses one."""

from collections.abc import Sequence
from typing import Any

from textual.content import Content
from textual.widgets import Static

from .views import View


class ViewTabs(Static):
    """One line; redrawn only when another view is chosen."""

    DEFAULT_CSS = "ViewTabs { height: 1; text-wrap: nowrap; text-overflow: ellipsis; padding: 0 1; }"

    def __init__(self, views: Sequence[View[Any]]) -> None:
        super().__init__(id="tabs")
        self._views = views
        self._shown: View[Any] | None = None

    def show(self, chosen: View[Any]) -> None:
        """Mark `chosen`, by more than a colour."""
        if chosen is self._shown:
            return
        self._shown = chosen
        parts = []
        for view in self._views:
            text = f"[{view.key} {view.title}]" if view is chosen else f" {view.key} {view.title} "
            style = "bold $text-primary" if view is chosen else "$foreground 60%"
            parts.append(Content(text).stylize(style).stylize(f"@click=app.pane('{view.name}')"))
        self.update(Content(" ").join(parts), layout=False)
