"""The object dictionary of a node as a list to choose from. Without a data sheet: what every device has or may have."""

from collections.abc import Iterator
from dataclasses import dataclass

from canopen import ObjectDictionary
from canopen.objectdictionary import ODRecord, ODVariable, datatypes

from canarm_protocol.canopen.dictionary import Dictionary
from canarm_protocol.decoding.sdo_texts import object_name

MOST_OBJECTS = 5000
MOST_SUBINDICES = 254


@dataclass(frozen=True, slots=True)
class Entry:
    """An object that can be read or written."""

    index: int
    subindex: int
    name: str
    variable: ODVariable

    @property
    def where(self) -> str:
        """Index and sub-index as they are written everywhere."""
        return f"{self.index:04X}:{self.subindex:02X}"

    @property
    def is_readable(self) -> bool:
        """Whether the data sheet lets it be read."""
        return bool(self.variable.readable)

    @property
    def is_writable(self) -> bool:
        """Whether the data sheet lets it be written."""
        return bool(self.variable.writable)


def entries_of(dictionary: Dictionary) -> list[Entry]:
    """All objects, by index and sub-index; at most `MOST_OBJECTS`."""
    found: list[Entry] = []
    for index in sorted(dictionary):
        for variable in _variables(dictionary[index]):
            name = object_name((index, variable.subindex), dictionary) or "–"
            found.append(Entry(index, variable.subindex, name, variable))
            if len(found) >= MOST_OBJECTS:
                return found
    return found


def _variables(entry: Dictionary) -> Iterator[ODVariable]:
    if isinstance(entry, ODVariable):
        yield entry
    else:
        yield from (member for _, member in sorted(entry.subindices.items())[: MOST_SUBINDICES + 1])


_COMMON = (
    (0x1000, 0, "Device type", datatypes.UNSIGNED32, "ro"),
    (0x1001, 0, "Error register", datatypes.UNSIGNED8, "ro"),
    (0x1003, 0, "Number of errors", datatypes.UNSIGNED8, "rw"),
    (0x1003, 1, "Newest error", datatypes.UNSIGNED32, "ro"),
    (0x1005, 0, "COB-ID SYNC", datatypes.UNSIGNED32, "rw"),
    (0x1008, 0, "Manufacturer device name", datatypes.VISIBLE_STRING, "const"),
    (0x1009, 0, "Manufacturer hardware version", datatypes.VISIBLE_STRING, "const"),
    (0x100A, 0, "Manufacturer software version", datatypes.VISIBLE_STRING, "const"),
    (0x1017, 0, "Producer heartbeat time, ms", datatypes.UNSIGNED16, "rw"),
    (0x1018, 1, "Vendor-ID", datatypes.UNSIGNED32, "ro"),
    (0x1018, 2, "Product code", datatypes.UNSIGNED32, "ro"),
    (0x1018, 3, "Revision number", datatypes.UNSIGNED32, "ro"),
    (0x1018, 4, "Serial number", datatypes.UNSIGNED32, "ro"),
)
"""Communication objects (CiA 301, 7.5.2)."""


def common_dictionary() -> Dictionary:
    """The communication objects that devices have, for one without a data sheet."""
    dictionary: Dictionary = ObjectDictionary()
    for index, subindex, name, data_type, access in _COMMON:
        variable = ODVariable(name, index, subindex)
        variable.data_type, variable.access_type = data_type, access
        if index in (0x1003, 0x1018):
            if index not in dictionary:
                dictionary.add_object(ODRecord("Errors" if index == 0x1003 else "Identity", index))
            dictionary[index].add_member(variable)
        else:
            dictionary.add_object(variable)
    return dictionary
