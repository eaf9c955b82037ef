"""Texts of others for people to see: the one way of a foreign text to a terminal, a log or a widget.

Names in a cell, a header of a file, an answer of a bench may hold escape sequences, which a terminal would obey, or be
endless. What they mean is the caller's.
"""

from typing import Any

LONGEST_LINE = 400
"""Of a text that is shown; of a longer one the middle is left out."""
LONGEST_OF_LINES = 4000
"""Of a line in a whole message, which may list a lot."""
MOST_LINES = 200


def printable(text: str, longest: int = LONGEST_LINE) -> str:
    """`text` on one line of bearable length, with escapes for what cannot be seen."""
    if len(text) > longest:
        text = f"{text[: longest // 2]} ... {text[-longest // 2 :]}"
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)


def printable_lines(text: str) -> str:
    """Each line of `text` made `printable`, at most `MOST_LINES` of them."""
    if len(text) <= LONGEST_OF_LINES and text.isprintable():
        return text
    lines = text.split("\n", MOST_LINES)
    more = ["..."] if len(lines) > MOST_LINES else []
    return "\n".join([*(printable(line, LONGEST_OF_LINES) for line in lines[:MOST_LINES]), *more])


def printable_values(value: Any) -> Any:
    """A value as JSON has them, with every text in it made `printable`, keys included."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):
        return [printable_values(each) for each in value]
    if isinstance(value, dict):
        return {printable(key): printable_values(each) for key, each in value.items()}
    return value
