"""Reads a user's text files, TOML, JSON and CSV within bounds: no path fills memory or hangs, no TOML takes for ever.

The caller knows what the text means, and words the error.
"""

import csv
import io
import json
import math
import os
import re
import stat
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .shown import quoted

MOST_PARTS = 32
"""Most parts of a dotted key: `tomllib` takes time that grows with their square."""
MOST_DIGITS = 600
"""Most digits of a whole number: Python can print so many whatever its limit is set to."""
_READ = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
"""Neither a pipe that nobody writes to nor a file of the kernel's that grows, such as /proc/kmsg, is waited for."""
_NO_KEYS = re.compile(
    r'"""(?:\\.|[^\\])*?(?:"{3,5}|\Z)|' r"'''.*?(?:'{3,5}|\Z)|" r'"(?:\\[^\n]|[^"\\\n])*"?|' r"'[^'\n]*'?|#[^\n]*",
    re.DOTALL,
)
"""Quoted strings and comments, in which dots mean nothing; an unterminated one reaches to the end of the text."""
_BEYOND = 10**MOST_DIGITS
_ENDS = re.compile(r"[\n=,\[\]{}]")
"""Characters that end a dotted key."""


def read_text(path: Path, largest_bytes: int, kind: str, form: str = "TOML") -> str:
    """The text of the regular file `path` in UTF-8, with or without a byte order mark.

    Errors call it `kind`, such as "a cell", and its format `form`. Raises `OSError` if it cannot be read, and
    `ValueError`, with what is wrong in a few words, if it is no regular file, too large or no text.
    """
    descriptor = os.open(path, _READ)
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise ValueError(f"is no regular file; {kind} is {_article(form)} {form} file")
        data = b""
        while len(data) <= largest_bytes and (more := os.read(descriptor, largest_bytes + 1 - len(data))):
            data += more
    except BlockingIOError:
        raise ValueError(f"has no end: more of it is to come; {kind} is {_article(form)} {form} file") from None
    finally:
        os.close(descriptor)
    if len(data) > largest_bytes:
        raise ValueError(f"is larger than {largest_bytes} bytes; is it {kind}?")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"is not a text in UTF-8; {kind} is {_article(form)} {form} file") from None


def _article(form: str) -> str:
    """Of an abbreviation, by the name of its first letter."""
    return "an" if form[0] in "AEFHILMNORSX" else "a"


class RowError(ValueError):
    """What is wrong with a row of a CSV file, and with which."""


def csv_rows(text: str) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    """The header of a CSV text, and its rows that are not blank, each with its number; the header is row 1.

    Raises `csv.Error`, and `RowError` for a row that is not as long as the header; both also while the rows are taken.
    """
    rows = csv.reader(io.StringIO(text, newline=""))
    header = [cell.strip() for cell in next(rows, [])]
    return header, _filled(rows, len(header))


def _filled(rows: Iterator[list[str]], columns: int) -> Iterator[tuple[int, list[str]]]:
    for number, row in enumerate(rows, start=2):
        if any(cell.strip() for cell in row):
            if len(row) != columns:
                raise RowError(f"row {number} has {len(row)} values; the header has {columns} columns")
            yield number, row


def finite(number: int, column: str, cell: str) -> float:
    """The value of a cell in row `number`. Raises `RowError` where it is no finite number."""
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RowError(f"row {number}, column {column}: {quoted(cell)} is not a finite number")
    return value


def parse_toml(text: str) -> dict[str, Any]:
    """The TOML `text` as a table. Raises `ValueError`, with what is wrong in a few words.

    Also refuses keys of more than `MOST_PARTS` parts, whole numbers of more than `MOST_DIGITS` digits, and brackets
    that are nested too deep for Python.
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


def parse_json(text: str) -> Any:
    """The JSON `text` as a value. Raises `ValueError`, with what is wrong in a few words, as `parse_toml`."""
    try:
        found = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"not valid JSON: {error}") from None
    except RecursionError:
        raise ValueError("brackets are nested too deep") from None
    except ValueError:  # more digits than Python converts
        raise _too_long() from None
    _check_numbers({"": found})
    return found


def _longest_key(text: str) -> int:
    """Parts of the longest dotted key; 0 if none can be too long."""
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
