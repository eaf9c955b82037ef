"""The parts of the screen that every view has around it: lines of words, and the faults.

Each draws given words; none keeps its own data, reads a clock or knows the bus.
"""

from textual.content import Content
from textual.widgets import Static

from .styles import line_of
from .texts import Word


class WordLine(Static):
    """One line of words; redrawn only when they change."""

    DEFAULT_CSS = "WordLine { height: 1; text-wrap: nowrap; text-overflow: ellipsis; padding: 0 1; }"

    def __init__(self, *, id: str, may_wrap: bool = False) -> None:
        super().__init__(id=id)
        self._may_wrap = may_wrap
        self.words: tuple[Word, ...] = ()

    def show(self, words: tuple[Word, ...]) -> None:
        """Show `words`."""
        if words != self.words:
            self.words = words
            self.update(line_of(words), layout=self._may_wrap)


class FaultPanel(Static):
    """Lines about faults; redrawn only when they change, hidden if there are none."""

    DEFAULT_CSS = """
    FaultPanel {
        display: none; height: auto; max-height: 9; text-wrap: nowrap; text-overflow: ellipsis; padding: 0 1;
        background: $surface;
    }
    FaultPanel.-shown { display: block; }
    """

    def __init__(self) -> None:
        super().__init__(id="faults")
        self.lines: tuple[tuple[Word, ...], ...] = ()

    def show(self, lines: tuple[tuple[Word, ...], ...]) -> None:
        """Show `lines`."""
        if lines != self.lines:
            has_resized = len(lines) != len(self.lines)
            self.lines = lines
            self.set_class(bool(lines), "-shown")
            self.update(Content("\n").join(line_of(words) for words in lines), layout=has_resized)
