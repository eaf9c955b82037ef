"""Texts that a user names or sends, read within bounds: no path can fill memory or hang, and no TOML takes for ever.

What the text means, and who is told of what is wrong, is the caller's.
"""

import re
import stat
import tomllib
from pathlib import Path
from typing import Any

MOST_PARTS = 32
"""Of a dotted key: `tomllib` takes a time that grows with their square."""
MOST_DIGITS = 600
"""Of a whole number: every Python shows such a one in an error message, however it is set up."""
_NO_KEYS = re.compile(
    r'"""(?:\\.|[^\\])*?(?:"{3,5}|\Z)|' r"'''.*?(?:'{3,5}|\Z)|" r'"(?:\\[^\n]|[^"\\\n])*"?|' r"'[^'\n]*'?|#[^\n]*",
    re.DOTALL,
)
"""Quoted texts and comments, in which dots mean nothing; one without an end reaches to that of the text."""
_BEYOND = 10**MOST_DIGITS
_ENDS = re.compile(r"[\n=,\[\]{}]")
"""What a dotted key does not reach beyond."""


def read_text(path: Path, largest_bytes: int, kind: str, form: str = "TOML") -> str:
    """The text of the regular file `path` in UTF-8, with or without a byte order mark.

    `kind` says in errors what it was taken for, such as "a cell", and `form` what such a file is. Raises `OSError`
    where it cannot be read, and `ValueError`, with what is wrong in a few words, where it is no such file, too large or
    no text.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise ValueError(f"is no regular file; {kind} is a {form} file")
    with path.open("rb") as file:
        data = file.read(largest_bytes + 1)
    if len(data) > largest_bytes:
        raise ValueError(f"is larger than {largest_bytes} bytes; is it {kind}?")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"is not a text in UTF-8; {kind} is a {form} file") from None


def parse_toml(text: str) -> dict[str, Any]:
    """The TOML `text` as a table. Raises `ValueError`, with what is wrong in a few words.

    Refused beside what is no TOML: keys of more than `MOST_PARTS` parts, whole numbers of more than `MOST_DIGITS`
    digits, and brackets nested deeper than Python can follow.
    """
    parts = _longest_key(text)
    if parts > MOST_PARTS:
        raise ValueError(f"a key of {parts} parts between dots; must have at most {MOST_PARTS}")
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"not valid TOML: {error}") from None
    except RecursionError:
        raise ValueError("brackets are nested too deep") from None
    except ValueError:  # more digits than Python converts
        raise _too_long() from None
    _check_numbers(table)
    return table


def _longest_key(text: str) -> int:
    """How many parts the longest dotted key has, where there may be one that is too long; 0 where there is none."""
    if all(line.count(".") < MOST_PARTS for line in text.split("\n")):
        return 0
    return 1 + max(part.count(".") for part in _ENDS.split(_NO_KEYS.sub("", text)))


def _check_numbers(table: dict[str, Any]) -> None:
    waiting: list[Any] = [table]
    while waiting:
        each = waiting.pop()
        if isinstance(each, dict):
            waiting += each.values()
        elif isinstance(each, list):
            waiting += each
        elif isinstance(each, int) and abs(each) >= _BEYOND:
            raise _too_long()


def _too_long() -> ValueError:
    return ValueError(f"a whole number is too long; must have at most {MOST_DIGITS} digits")
