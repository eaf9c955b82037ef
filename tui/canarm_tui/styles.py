"""The colours of tones, and words as content that textual can draw. Colours are variables of the theme."""

from collections.abc import Iterable, Sequence

from rich.style import Style
from textual.content import Content
from textual.style import Style as VisualStyle
from textual.widget import Widget

from canarm_protocol.shown import printable

from .texts import SEPARATOR, Tone, Word

STYLES: dict[Tone, str] = {
    Tone.PLAIN: "$foreground",
    Tone.DIM: "$foreground 60%",
    Tone.GOOD: "$text-success",
    Tone.WARNING: "bold $text-warning",
    Tone.BAD: "bold $text-error",
    Tone.CHANGED: "bold underline $text-accent",
}


def drawn_style(widget: Widget, style: str) -> Style:
    """`style`, such as those of `STYLES`, on the background of `widget`.

    A component class says the same in CSS, but each one is looked up anew for every widget whenever a dashboard starts.
    """
    return (widget.visual_style + VisualStyle.parse(style)).rich_style


def title_of(words: Sequence[Word], width: int) -> Content:
    """As many of `words` as `width` cells hold, each whole: closer together first, then without the last ones."""
    for separator in (SEPARATOR, " "):
        line = line_of(words, separator)
        if line.cell_length <= width:
            return line
    kept = list(words)
    while len(kept) > 1 and line_of(kept, " ").cell_length > width:
        kept.pop()
    wide = line_of(kept)
    return wide if wide.cell_length <= width else line_of(kept, " ")


def line_of(words: Iterable[Word], separator: str = SEPARATOR) -> Content:
    """`words` in their colours, with separators."""
    parts: list[Content] = []
    for word in words:
        if parts:
            parts.append(Content.styled(separator, STYLES[Tone.DIM]))
        parts.append(Content.styled(printable(word.text), STYLES[word.tone]))
    return Content("").join(parts)
