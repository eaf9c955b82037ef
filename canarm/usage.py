"""Defaults, and the error for impossible requests. Imports little: `canarm --help` needs it."""

import contextlib
import math
from collections.abc import Iterable, Sequence
from numbers import Real

from canarm_protocol.errors import UsageError
from canarm_protocol.shown import printable, quoted

__all__ = [
    "DEFAULT_CELL",
    "DEFAULT_LAW",
    "DEFAULT_TRAJECTORY",
    "LARGEST_SEED",
    "UsageError",
    "check_number",
    "key_values",
    "parse_settings",
    "value_text",
]

DEFAULT_CELL, DEFAULT_LAW, DEFAULT_TRAJECTORY = "konkuk1", "mras", "sine"
LARGEST_SEED = 2**63 - 1
"""What a table of a study holds, and TOML."""


def check_number(what: str, value: object, lowest: float = -math.inf) -> None:
    """Raises `UsageError` unless `value` is a number, NaN excepted, that a float can hold and is at least `lowest`."""
    try:
        number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:
        raise UsageError(f"{what} {quoted(value)}: is too large for a number") from None
    if math.isnan(number):
        raise UsageError(f"{what} {quoted(value)}: must be a number")
    if number < lowest:
        raise UsageError(f"{what} {quoted(value)}: must be {lowest:g} or more")


def parse_settings(option: str, words: Sequence[str]) -> dict[str, str]:
    """`key=value` words as a dict. Raises `UsageError` for any other word, and for a key given twice."""
    return key_values(words, f"{option} ", "; keys: canarm check --keys")


def key_values(words: Iterable[str], before: str, hint: str) -> dict[str, str]:
    """`key=value` words as a dict; `before` and `hint` stand around the complaint. Raises `UsageError`."""
    values: dict[str, str] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key or not value:
            raise UsageError(f"{before}{printable(word)}: write KEY=VALUE{hint}")
        if key in values:
            raise UsageError(f"{before}{printable(word)}: {printable(key)} is given twice")
        values[key] = value
    return values


def value_text(value: object) -> str:
    """One value as text: bools as true or false, numpy's numbers as plain ones. Raises `UsageError` if it has none."""
    plain = value
    if hasattr(value, "item"):
        with contextlib.suppress(TypeError, ValueError):  # an array of several
            plain = value.item()
    try:
        return str(plain).lower() if isinstance(plain, bool) else str(plain)
    except Exception:  # a number of thousands of digits, or an object whose own code fails
        raise UsageError(f"{quoted(value)}: cannot be written as text") from None
