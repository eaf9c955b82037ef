"""Values of objects as text: what an SDO carries in words, and what a user types as bytes, checked by type and limits.

The types, lengths and limits are those of the dictionary; nothing here knows a bus.
"""

import math
import re

from canopen.objectdictionary import ODVariable, datatypes

from ..errors import ProtocolError
from ..shown import printable

LONGEST_NUMBER = 40
"""Characters; `int` refuses a few thousand."""
MOST_SHOWN = 64
"""Bytes of a value without a type that are shown."""
TYPE_NAMES: dict[int, str] = {
    number: name for name, number in vars(datatypes).items() if name.isupper() and isinstance(number, int)
}
"""Data types by number (CiA 301, table 44)."""
_WHOLE = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|[0-9]+)", re.ASCII)
_BYTES = re.compile(r"(?:[0-9a-fA-F]{2}[\s:]*)*", re.ASCII)
_BOOLEANS = {"0": False, "1": True, "false": False, "true": True}


class ValueTextError(ProtocolError):
    """A text is no value of an object."""


def whole_number(text: str) -> int | None:
    """A whole number, in decimal or as 0x..; None for anything else."""
    if len(text) > LONGEST_NUMBER or not _WHOLE.fullmatch(text):
        return None
    return int(text, 16 if "x" in text.lower() else 10)


def value_text(variable: ODVariable | None, data: bytes) -> str:
    """What `data` says as the value of `variable`; as bytes where the type is not known or the length is another."""
    if variable is not None and variable.data_type in (datatypes.VISIBLE_STRING, datatypes.UNICODE_STRING):
        return printable(str(variable.decode_raw(data)))
    if variable is not None and variable.fixed_size and len(data) * 8 == len(variable):
        value = variable.decode_raw(data)
        shown = f"{value:.7g}" if isinstance(value, float) else str(value)
        return f"{shown} (0x{data[::-1].hex().upper()})"
    more = "…" if len(data) > MOST_SHOWN else ""
    return f"{data[:MOST_SHOWN].hex(' ')}{more}"


def limits_of(variable: ODVariable, is_limited: bool = True) -> tuple[int, int] | None:
    """The least and the greatest value of an integer: by its type and, if `is_limited`, by the limits in the EDS."""
    if variable.data_type not in datatypes.INTEGER_TYPES:
        return None
    bits = len(variable)
    low, high = (0, (1 << bits) - 1)
    if variable.data_type in datatypes.SIGNED_TYPES:
        low, high = -(1 << bits - 1), (1 << bits - 1) - 1
    if not is_limited:
        return low, high
    return (
        low if variable.min is None else max(low, int(variable.min)),
        high if variable.max is None else min(high, int(variable.max)),
    )


def type_text(variable: ODVariable) -> str:
    """Type and limits, as a user needs them before typing a value."""
    name = TYPE_NAMES.get(variable.data_type or 0, f"type {variable.data_type}").lower()
    limits = limits_of(variable)
    return name if limits is None else f"{name} {limits[0]} to {limits[1]}"


def value_bytes(variable: ODVariable | None, text: str, is_limited: bool = True) -> bytes:
    """The bytes of `text` as the value of `variable`; without one, or for a DOMAIN, hexadecimal bytes.

    Integers have to be within the type's limits and, if `is_limited`, those in the EDS.

    Raises `ValueTextError`, which says what would be right.
    """
    kind = None if variable is None else variable.data_type
    if variable is None or kind in (datatypes.DOMAIN, datatypes.OCTET_STRING) or kind not in TYPE_NAMES:
        if not _BYTES.fullmatch(text.strip()) or not text.strip():
            raise ValueTextError(f"{printable(text)}: must be bytes in hexadecimal, such as 01 ff")
        return bytes.fromhex(text.replace(":", " "))
    if kind == datatypes.BOOLEAN:
        if text.strip().lower() not in _BOOLEANS:
            raise ValueTextError(f"{printable(text)}: must be 0 or 1")
        return bytes([_BOOLEANS[text.strip().lower()]])
    if kind in datatypes.FLOAT_TYPES:
        return _real_bytes(variable, text)
    limits = limits_of(variable, is_limited)
    if limits is not None:
        value = whole_number(text.strip())
        if value is None or not limits[0] <= value <= limits[1]:
            raise ValueTextError(
                f"{printable(text)}: must be a whole number from {limits[0]} to {limits[1]} (0x.. is hexadecimal)"
            )
        return value.to_bytes(len(variable) // 8, "little", signed=kind in datatypes.SIGNED_TYPES)
    try:
        return bytes(variable.encode_raw(text))
    except (UnicodeError, TypeError, ValueError):
        raise ValueTextError(f"{printable(text)}: must be text in ASCII") from None


def _real_bytes(variable: ODVariable, text: str) -> bytes:
    try:
        value = float(text)
        if not math.isfinite(value):
            raise ValueError
        return bytes(variable.encode_raw(value))
    except (ValueError, OverflowError):
        name = TYPE_NAMES[variable.data_type or 0]
        raise ValueTextError(f"{printable(text)}: must be a finite number that fits {name}") from None
