"""What a frame means, as values: a sort, a title, fields with their bits. No colours, no widths."""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Protocol


class Sort(Enum):
    """Sorts of messages, by the words that users know them by."""

    NMT = "NMT"
    SYNC = "SYNC"
    TIME = "TIME"
    EMERGENCY = "EMCY"
    PDO = "PDO"
    SDO = "SDO"
    HEARTBEAT = "heartbeat"
    DATABASE = "DBC"
    ERROR = "error"
    OTHER = "other"


class Field(NamedTuple):
    """A part of a frame's data: its value in words, with unit, and its bits.

    `start_bit` counts as DBC does: bit n is bit n % 8 of byte n // 8. Little-endian, it is the least significant bit,
    big-endian the most significant one.
    """

    name: str
    text: str
    start_bit: int
    bit_length: int
    is_big_endian: bool = False

    @property
    def bits(self) -> tuple[int, ...]:
        """All its bits, numbered as `start_bit` is."""
        if not self.is_big_endian:
            return tuple(range(self.start_bit, self.start_bit + self.bit_length))
        found, bit = [], self.start_bit
        for _ in range(self.bit_length):
            found.append(bit)
            bit = bit - 1 if bit % 8 else bit + 15
        return tuple(found)


@dataclass(frozen=True, slots=True)
class Meaning:
    """A frame in words. `is_wrong` marks what breaks a protocol, and what reports that something is wrong."""

    sort: Sort
    title: str
    fields: tuple[Field, ...] = ()
    said: str = ""
    """What it says where that is not the list of its fields."""
    is_wrong: bool = False

    @property
    def text(self) -> str:
        """What it says, on one line."""
        return self.said or ", ".join(f"{field.name} {field.text}" for field in self.fields)

    def __str__(self) -> str:
        return f"{self.title}: {self.text}" if self.text else self.title


class KnownMessage(Protocol):
    """A message that somebody has described."""

    @property
    def title(self) -> str:
        """Its name."""

    @property
    def sort(self) -> Sort:
        """Who describes it: `PDO` or `DATABASE`."""

    def fields(self, data: bytes) -> tuple[Field, ...]:
        """Its parts. Raises `FrameError` for data that are not long enough."""
