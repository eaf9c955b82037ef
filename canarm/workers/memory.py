"""Memory of a process that does one task after the other for hours."""

import ctypes
from collections.abc import Callable
from functools import cache


@cache
def _trim() -> Callable[[int], int] | None:
    try:
        found: Callable[[int], int] = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return None
    return found


def give_back() -> None:
    """Give memory that is free to the system, where the C library keeps it.

    glibc does, torn into pieces: some 6 MB in a thousand runs, though no object is left of any.
    """
    trim = _trim()
    if trim is not None:
        trim(0)
