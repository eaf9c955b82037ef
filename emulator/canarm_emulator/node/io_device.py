"""What a node needs of the device behind its objects: how to read and write values, and what a reset does to them.

The interface only; the device may be a card or the bench itself.
"""

from collections.abc import Callable
from typing import Any, Protocol

Setter = Callable[[Any], None]
"""Writes an object's value: an int, a float, a text or bytes, as its data type says."""
Getter = Callable[[], float | str | bytes]
"""Reads an object's value."""
Refusal = Callable[[Any], bool]
"""Whether a value of an output object asks for what the outputs never give."""
ReadObject = Callable[[int, int], int]
"""Gives the value of the integer object with an index and a sub-index."""


class IoDevice(Protocol):
    """A card's process data as CiA 401 objects."""

    def setter(self, index: int, subindex: int) -> Setter | None:
        """How to write an output object, or None where there is none."""
        ...

    def refusal(self, index: int, subindex: int) -> Refusal | None:
        """How to tell which values of an output object a client may not write; None where it may write all.

        One that comes in an RPDO acts as far as it can, and is reported.
        """
        ...

    def getter(self, index: int, subindex: int) -> Getter | None:
        """How to read an input or output object, or None where there is none."""
        ...

    def refresh(self, index: int, subindex: int) -> None:
        """Bring an input up to date because it is about to be read outside the cycle."""
        ...

    def configure(self, read: ReadObject) -> None:
        """Take over parameters, at a reset and after a client has changed one; `read(index, subindex)` gives them."""
        ...

    def power_off(self) -> None:
        """Set the outputs as the hardware has them without power."""
        ...

    def take_error_values(self, read: ReadObject) -> None:
        """Set the outputs to the values configured for errors; `read(index, subindex)` gives the configuration."""
        ...
