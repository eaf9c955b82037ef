"""What a bench node answers, read within bounds: a bench on somebody's bus may be broken, or hostile.

Bytes in, plain values out, every text in them fit to be shown. Who asked, and over which bus, is not known here.
"""

import json
import zlib
from typing import Any, TypeVar

from ..shown import printable_values

LARGEST_UNPACKED = 8 << 20
"""Bytes; the catalogue of the largest cell has less than one million."""

P = TypeVar("P", dict[str, Any], list[Any])


def unpacked(data: bytes) -> bytes:
    """An object that was packed: 408 kB of zeros can be 842 MB, so no more is unpacked than makes sense.

    Raises `ValueError`, with what is wrong in a few words.
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
