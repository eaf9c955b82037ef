"""Messages of a DBC file, read and decoded by cantools, which is loaded for that alone."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import FrameError, ProtocolError
from ..shown import first_line, printable
from ..text_file import read_text
from .book import Book
from .meaning import Field, Sort
from .signals import number_text

LARGEST_BYTES = 32 << 20


class DatabaseError(ProtocolError):
    """A CAN database cannot be used, or cantools is not installed."""


@dataclass(frozen=True, slots=True)
class DatabaseMessage:
    """A message as cantools decodes it."""

    title: str
    message: Any
    sort: Sort = Sort.DATABASE

    def fields(self, data: bytes) -> tuple[Field, ...]:
        """The signals that are in `data`: of multiplexed ones, those that are there. Raises `FrameError`."""
        try:
            values = self.message.decode_simple(data, decode_choices=True)
        # It raises what its parts raise, for data that are too short above all.
        except Exception as error:
            raise FrameError(first_line(error)) from None
        found = []
        for signal in self.message.signals:
            if signal.name in values:
                is_big = signal.byte_order == "big_endian"
                text = _text(values[signal.name], signal)
                found.append(Field(printable(signal.name, 60), text, signal.start, signal.length, is_big))
        return tuple(found)


def load_databases(book: Book, path: Path) -> int:
    """Enter the messages of a file; returns how many they are. Raises `DatabaseError`."""
    name = printable(str(path))
    try:
        from cantools.database import load_string
    except ImportError:
        raise DatabaseError(f"{name}: reading it needs cantools; pip install 'canarm[dbc]'") from None
    try:
        text = read_text(path, LARGEST_BYTES, "a CAN database", "DBC")
        database = load_string(text, database_format="dbc", strict=False)
    except OSError as error:
        raise DatabaseError(f"{name}: {error.strerror or first_line(error)}; name a DBC file") from None
    # Its parsers raise what their parts raise.
    except Exception as error:
        raise DatabaseError(f"{name}: cannot be read as a CAN database: {first_line(error)}") from None
    messages = [each for each in getattr(database, "messages", ()) if not each.is_container]
    if not messages:
        raise DatabaseError(f"{name}: describes no message; is it a CAN database?")
    for each in messages:
        book.messages[each.frame_id, each.is_extended_frame] = DatabaseMessage(printable(each.name, 60), each)
    return len(messages)


def _text(value: Any, signal: Any) -> str:
    unit = printable(str(signal.unit or ""), 12)
    if isinstance(value, float):
        return number_text(value, abs(float(signal.conversion.scale or 0)), unit)
    return printable(f"{value} {unit}".rstrip(), 60)
