"""Foreign text made safe to show: the only way of such text to a terminal, a log or a widget.

Names in a cell, headers of a file and answers of a bench may hold escape sequences, which a terminal would obey, or be
endless.
"""

import re
from typing import Any

LONGEST_LINE = 200
"""Longest foreign text that is shown, in characters; the middle of a longer one is left out."""
LONGEST_OF_LINES = 1000
"""Longest line of a message, which may list a lot."""
MOST_LINES = 200
AROUND = 50
"""What may stand around a shortened text without a blank: quotes, a key, a colon."""
_LONG_WORD = re.compile(rf"\S{{{LONGEST_LINE + AROUND},}}")


def printable(text: str, longest: int = LONGEST_LINE) -> str:
    """`text` on one line, shortened to `longest`, with escapes for unprintable characters."""
    text = _shortened(text, longest)
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)


def quoted(value: object) -> str:
    """A value that a user, a file or a bench has given, as Python writes it, made `printable`."""
    try:
        return printable(repr(value))
    except Exception:  # a number of thousands of digits, or an object whose own code fails
        return f"(a value of type {printable(type(value).__name__)})"


def name_of(code: object) -> str:
    """What a function, a class or what can be called like one is named; "a function" if it has no name."""
    name = getattr(code, "__name__", None)
    if name is None and hasattr(code, "func"):  # functools.partial
        return name_of(code.func)
    return "a function" if name == "<lambda>" else str(name or type(code).__name__)


def first_line(error: object) -> str:
    """What a library says that went wrong, an exception or its text: the first line that says anything."""
    lines = (" ".join(line.split()) for line in str(error).splitlines())
    return printable(next(filter(None, lines), type(error).__name__))


def named_error(error: BaseException) -> str:
    """An exception that nobody has foreseen, by its type and its `first_line`."""
    said, name = first_line(error), type(error).__name__
    return name if said == name else f"{name}: {said}"


def printable_lines(text: str) -> str:
    """Each line of `text` made `printable`, at most `MOST_LINES` of them.

    A message may be longer than a text that it quotes; none of its words is.
    """
    if len(text) <= LONGEST_LINE and text.isprintable():
        return text
    lines = text.split("\n", MOST_LINES)
    more = ["…"] if len(lines) > MOST_LINES else []
    return "\n".join([*(_printable_line(line) for line in lines[:MOST_LINES]), *more])


def _printable_line(line: str) -> str:
    words = _LONG_WORD.sub(lambda word: _shortened(word.group(), LONGEST_LINE), _shortened(line, 1 << 16))
    return printable(words, LONGEST_OF_LINES)


def _shortened(text: str, longest: int) -> str:
    half = longest // 2
    return text if len(text) <= longest else f"{text[:half]}…{text[half - longest :]}"


def printable_values(value: Any) -> Any:
    """A JSON value with all its texts made `printable`, keys included."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):
        return [printable_values(each) for each in value]
    if isinstance(value, dict):
        return {printable(key): printable_values(each) for key, each in value.items()}
    return value
