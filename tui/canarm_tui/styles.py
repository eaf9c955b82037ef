"""The colours of tones, and words as content that textual can draw. Colours are variables of the theme."""

from collections.abc import Iterable

from textual.content import Content

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


def line_of(words: Iterable[Word]) -> Content:
    """`words` in their colours, with separators."""
    parts: list[Content] = []
    for word in words:
        if parts:
            parts.append(Content.styled(SEPARATOR, STYLES[Tone.DIM]))
        parts.append(Content.styled(printable(word.text), STYLES[word.tone]))
    return Content("").join(parts)
