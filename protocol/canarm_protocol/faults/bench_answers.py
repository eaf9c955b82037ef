"""Reads the answers of a bench node within bounds: a bench on somebody's bus may be broken or hostile.

Bytes in, plain values out, with every text safe to show. The request and the bus are not known here.
"""

import json
import zlib
from typing import Any, TypeVar

from ..shown import printable_values

LARGEST_UNPACKED = 8 << 20
"""In bytes; the catalogue of the largest cell has less than one million."""

P = TypeVar("P", dict[str, Any], list[Any])


def unpacked(data: bytes) -> bytes:
    """A packed object, at most `LARGEST_UNPACKED` bytes of it: 408 kB can unpack to 842 MB of zeros.

    Raises `ValueError` that says in a few words what is wrong.
    """
    unpacker = zlib.decompressobj()
    try:
        text = unpacker.decompress(data, LARGEST_UNPACKED)
    except zlib.error:
        raise ValueError("what it holds cannot be unpacked") from None
    if not unpacker.eof:
        reason = f"is longer than {LARGEST_UNPACKED} bytes" if len(text) >= LARGEST_UNPACKED else "is cut short"
        raise ValueError(f"what it holds {reason}")
    return text


def plain_of(data: bytes, kind: type[P]) -> P:
    """The JSON `data`, of the type that it should have. Raises `ValueError`."""
    try:
        plain = json.loads(data)
    except (ValueError, RecursionError):
        plain = None
    if not isinstance(plain, kind):
        raise ValueError("what it says makes no sense")
    return kind(printable_values(plain))
