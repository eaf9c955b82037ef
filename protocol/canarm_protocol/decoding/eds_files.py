"""EDS and DCF files of any CANopen device: its dictionary, and its PDOs as the file maps them.

Unlike the cards' own data sheets, these are foreign: mappings by bits, dummy entries, objects that are not described.
"""

import io
import re
from dataclasses import dataclass
from pathlib import Path

import canopen
from canopen.objectdictionary import datatypes

from ..canopen.dictionary import Dictionary, variable_at
from ..canopen.frames import EXTENDED_FLAG
from ..canopen.pdo import COB_ID_MASK, COMMUNICATION, DISABLED, MAPPING, MOST_BYTES, Kind, pdo_numbers
from ..cell.dbc_file import Signal
from ..errors import DictionaryError
from ..shown import first_line, printable
from ..text_file import read_text
from .book import Book
from .sdo_texts import object_name
from .signals import SignalMessage

LARGEST_BYTES = 4 << 20
MOST_ENTRIES = 254
"""Of an array: sub-indices are 1 to 254 (CiA 301, 7.4.2)."""
MOST_MAPPED = 64
"""Objects in a PDO (CiA 301, 7.5.2.36)."""
_FIRST_OBJECT = 0x1000
"""What is mapped below is a dummy, which fills a gap."""
_COUNTS = re.compile(r"^\s*(?:NrOfEntries|CompactSubObj)\s*=\s*(\w+)", re.MULTILINE | re.ASCII)


@dataclass(frozen=True, slots=True)
class DataSheet:
    """An EDS or DCF file that has been read. `node_id` is the one that a DCF is for."""

    name: str
    text: str
    node_id: int | None

    @classmethod
    def load(cls, path: Path) -> "DataSheet":
        """Read a file. Raises `DictionaryError`, with what is wrong, for one that cannot be used."""
        name = printable(str(path))
        try:
            text = read_text(path, LARGEST_BYTES, "a data sheet", "EDS")
        except OSError as error:
            raise DictionaryError(f"{name}: {error.strerror or first_line(error)}; name an EDS or DCF file") from None
        except ValueError as error:
            raise DictionaryError(f"{name}: {error}") from None
        sheet = cls(name, text, None)
        node_id = sheet.dictionary(None).node_id
        return sheet if node_id is None else cls(name, text, node_id)

    def dictionary(self, node_id: int | None) -> Dictionary:
        """Its objects, with `node_id` in the place of $NODEID. Raises `DictionaryError`."""
        for count in _COUNTS.findall(self.text):
            if (
                not count.isalnum()
                or len(count) > 5
                or int(count, 0 if count[0] == "0" and len(count) > 1 else 10) > MOST_ENTRIES
            ):
                raise DictionaryError(f"{self.name}: an array of {count} entries; sub-indices are 1 to {MOST_ENTRIES}")
        source = io.StringIO(self.text)
        source.name = "sheet.eds"
        try:
            dictionary = canopen.import_od(source, node_id)
        # The library's reader raises whatever its parts raise.
        except Exception as error:
            raise DictionaryError(f"{self.name}: cannot be read as an EDS (CiA 306): {first_line(error)}") from None
        if not len(dictionary):
            raise DictionaryError(f"{self.name}: describes no object; is it an EDS (CiA 306)?")
        return dictionary

    def enter(self, book: Book, node_id: int) -> None:
        """Enter the device as node `node_id`. Raises `DictionaryError`."""
        dictionary = self.dictionary(node_id)
        book.dictionaries[node_id] = dictionary
        name = book.names.get(node_id)
        if name is None:
            product = printable(str(dictionary.device_information.product_name or ""), 24)
            name = f"{product} 0x{node_id:02X}" if product else book.name(node_id)
            book.names[node_id] = name
        kinds: tuple[Kind, ...] = ("rpdo", "tpdo")
        for kind in kinds:
            for number in pdo_numbers(dictionary, kind):
                message = _message(dictionary, kind, number, name)
                if message is not None:
                    book.messages[message[0], False] = message[1]


def _message(dictionary: Dictionary, kind: Kind, number: int, name: str) -> tuple[int, SignalMessage] | None:
    """COB-ID and layout of an enabled PDO with an 11-bit COB-ID; None for another."""
    cob_id = _value(dictionary, COMMUNICATION[kind] + number - 1, 1)
    mapping = MAPPING[kind] + number - 1
    count = _value(dictionary, mapping, 0)
    if cob_id is None or count is None or cob_id & (DISABLED | EXTENDED_FLAG) or not cob_id & COB_ID_MASK:
        return None
    signals, bit = [], 0
    for position in range(1, min(count, MOST_MAPPED) + 1):
        entry = _value(dictionary, mapping, position) or 0
        index, subindex, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
        if not bits or bit + bits > 8 * MOST_BYTES:
            break
        if index >= _FIRST_OBJECT:
            signals.append(_signal(dictionary, index, subindex, bit, bits))
        bit += bits
    return cob_id & COB_ID_MASK, SignalMessage(f"{kind.upper()}{number} of {name}", (bit + 7) // 8, tuple(signals))


def _signal(dictionary: Dictionary, index: int, subindex: int, bit: int, bits: int) -> Signal:
    variable = variable_at(dictionary, index, subindex)
    name = object_name((index, subindex), dictionary) or f"0x{index:04X}:{subindex:02X}"
    if variable is None:
        return Signal(name, bit, bits)
    return Signal(
        name,
        bit,
        bits,
        is_signed=variable.data_type in datatypes.SIGNED_TYPES,
        is_float=variable.data_type in datatypes.FLOAT_TYPES and bits in (32, 64),
        factor=float(variable.factor),
        unit=printable(str(variable.unit or ""), 12),
    )


def _value(dictionary: Dictionary, index: int, subindex: int) -> int | None:
    """The value that the file gives an object: a DCF's own, or the default."""
    variable = variable_at(dictionary, index, subindex)
    if variable is None:
        return None
    given = variable.value if variable.value is not None else variable.default
    return given if isinstance(given, int) else None
