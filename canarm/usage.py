"""Defaults, and the error for impossible requests. Imports little: `canarm --help` needs it."""

import contextlib
from collections.abc import Iterable, Sequence

from canarm_protocol.errors import CanarmError
from canarm_protocol.shown import printable

DEFAULT_CELL, DEFAULT_LAW, DEFAULT_TRAJECTORY = "konkuk1", "mras", "sine"


class UsageError(CanarmError, ValueError):
    """An impossible request by the user: exit status 2, and in Python a `ValueError`."""


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
    """One value as text: bools as true or false, numpy's numbers as plain numbers."""
    plain = value
    if hasattr(value, "item"):
        with contextlib.suppress(TypeError, ValueError):  # an array of several
            plain = value.item()
    return str(plain).lower() if isinstance(plain, bool) else str(plain)
