"""The line of keys at the bottom: as many as there is room for, each whole, and the most important ones always.

What keys do is not known here.
"""

from collections.abc import Sequence

from textual.app import ComposeResult
from textual.events import Resize
from textual.widgets import Footer
from textual.widgets._footer import FooterKey

FIRST = ("help", "quit", "inject", "stop", "pause")
"""Actions in the order in which their keys are kept; all others stand behind, in the order of the screen."""
PADDING = 3
"""Blanks around a key and behind what it does."""


class KeysLine(Footer):
    """Textual's own cuts off what does not fit."""

    def __init__(self) -> None:
        super().__init__(show_command_palette=False)
        self._width = 0

    def compose(self) -> ComposeResult:
        """The keys that have room."""
        self._width = self.app.size.width
        yield from _fitting([each for each in super().compose() if isinstance(each, FooterKey)], self._width)

    async def on_resize(self, event: Resize) -> None:
        """There is room for others."""
        if self.app.size.width != self._width:
            await self.recompose()


def _fitting(keys: Sequence[FooterKey], width: int) -> list[FooterKey]:
    """Those of `keys` that fit `width` columns, in their order."""
    kept: set[FooterKey] = set()
    for key in sorted(keys, key=_rank):
        length = len(key.key_display) + len(key.description) + PADDING
        if length <= width:
            kept.add(key)
            width -= length
    return [key for key in keys if key in kept]


def _rank(key: FooterKey) -> int:
    action = key.action.rpartition(".")[2]
    return FIRST.index(action) if action in FIRST else len(FIRST)
