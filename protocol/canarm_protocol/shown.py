"""Foreign text made safe to show: the only way of such text to a terminal, a log or a widget.

Names in a cell, headers of a file and answers of a bench may hold escape sequences, which a terminal would obey, or be
endless.
"""

from typing import Any

LONGEST_LINE = 400
"""Longest text that is shown, in characters; the middle of a longer one is left out."""
LONGEST_OF_LINES = 4000
"""Longest line of a message, which may list a lot."""
MOST_LINES = 200
LONGEST_REASON = 200
"""Longest reason quoted from a library's error, in characters."""


def printable(text: str, longest: int = LONGEST_LINE) -> str:
    """`text` on one line, shortened to `longest`, with escapes for unprintable characters."""
    if len(text) > longest:
        text = f"{text[: longest // 2]} ... {text[-longest // 2 :]}"
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)


def first_line(error: object) -> str:
    """What a library says that went wrong, an exception or its text: the first line that says anything."""
    lines = (" ".join(line.split()) for line in str(error).splitlines())
    return printable(next(filter(None, lines), type(error).__name__), LONGEST_REASON)


def named_error(error: BaseException) -> str:
    """An exception that nobody has foreseen, by its type and its `first_line`."""
    said, name = first_line(error), type(error).__name__
    return name if said == name else f"{name}: {said}"


def printable_lines(text: str) -> str:
    """Each line of `text` made `printable`, at most `MOST_LINES` of them."""
    if len(text) <= LONGEST_OF_LINES and text.isprintable():
        return text
    lines = text.split("\n", MOST_LINES)
    more = ["..."] if len(lines) > MOST_LINES else []
    return "\n".join([*(printable(line, LONGEST_OF_LINES) for line in lines[:MOST_LINES]), *more])


def printable_values(value: Any) -> Any:
    """A JSON value with all its texts made `printable`, keys included."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):
        return [printable_values(each) for each in value]
    if isinstance(value, dict):
        return {printable(key): printable_values(each) for key, each in value.items()}
    return value
