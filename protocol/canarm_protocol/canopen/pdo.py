"""Process data objects: their layout, from a dictionary or a configured node, and packing and unpacking their data.

Only byte-aligned objects can be mapped: the cards need no others, and one struct call does the work.
"""

import itertools
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from canopen.objectdictionary import datatypes

from ..errors import DictionaryError
from .dictionary import Dictionary, variable_at

Kind = Literal["rpdo", "tpdo"]
COMMUNICATION: dict[Kind, int] = {"rpdo": 0x1400, "tpdo": 0x1800}
MAPPING: dict[Kind, int] = {"rpdo": 0x1600, "tpdo": 0x1A00}
PDO_COUNT = 512
MOST_BYTES = 8
"""Data bytes of a classical CAN frame."""
DISABLED = 0x8000_0000
"""Bit 31 of a PDO's COB-ID: the PDO does not exist (CiA 301, 7.5.2.35)."""
COB_ID_MASK = 0x7FF

_FORMATS = {
    datatypes.BOOLEAN: "?",
    datatypes.INTEGER8: "b",
    datatypes.INTEGER16: "h",
    datatypes.INTEGER32: "i",
    datatypes.INTEGER64: "q",
    datatypes.UNSIGNED8: "B",
    datatypes.UNSIGNED16: "H",
    datatypes.UNSIGNED32: "I",
    datatypes.UNSIGNED64: "Q",
    datatypes.REAL32: "f",
    datatypes.REAL64: "d",
}


_SIGNED = frozenset("bhiq")


@dataclass(frozen=True, slots=True)
class MappedObject:
    """One object in a PDO: its place in the dictionary, and the `struct` format character of its bytes."""

    index: int
    subindex: int
    format: str

    @property
    def bits(self) -> int:
        """Length in the PDO."""
        return 8 * struct.calcsize("<" + self.format)

    @property
    def is_signed(self) -> bool:
        """Whether it is a signed number."""
        return self.format in _SIGNED

    @property
    def entry(self) -> int:
        """The value of the mapping parameter: index, sub-index, length in bits (CiA 301, 7.5.2.36)."""
        return self.index << 16 | self.subindex << 8 | self.bits


class PdoLayout:
    """One PDO: number (from 1), COB-ID, transmission type and mapped objects; packs and unpacks its data."""

    __slots__ = ("cob_id", "kind", "number", "objects", "pack", "size", "transmission_type", "unpack")

    def __init__(
        self, kind: Kind, number: int, cob_id: int, transmission_type: int, objects: Sequence[MappedObject]
    ) -> None:
        layout = struct.Struct("<" + "".join(mapped.format for mapped in objects))
        if layout.size > MOST_BYTES:
            raise DictionaryError(f"{kind.upper()}{number} maps {layout.size} bytes; a PDO has at most {MOST_BYTES}")
        self.kind, self.number, self.cob_id, self.transmission_type = kind, number, cob_id, transmission_type
        self.objects = tuple(objects)
        self.size = layout.size
        self.pack: Callable[..., bytes] = layout.pack
        self.unpack: Callable[[bytes], tuple[Any, ...]] = layout.unpack
        """A number for each object: whole, but for those of type REAL32."""

    def __repr__(self) -> str:
        objects = ", ".join(f"0x{mapped.index:04X}:{mapped.subindex:02X}" for mapped in self.objects)
        return f"<{self.kind.upper()}{self.number} 0x{self.cob_id:03X} type {self.transmission_type}: {objects}>"

    @property
    def bit_offsets(self) -> tuple[int, ...]:
        """The first bit of each of `objects`."""
        return (0, *itertools.accumulate(mapped.bits for mapped in self.objects[:-1]))

    def restricted_to(self, wanted: Callable[[MappedObject], bool]) -> "PdoLayout":
        """This PDO with only the mapped objects that are `wanted`."""
        return self.mapping(list(filter(wanted, self.objects)))

    def mapping(self, objects: Sequence[MappedObject]) -> "PdoLayout":
        """This PDO with other objects mapped. Raises `DictionaryError` for more than fit."""
        return PdoLayout(self.kind, self.number, self.cob_id, self.transmission_type, objects)


def mapped_object(dictionary: Dictionary, entry: int) -> MappedObject:
    """Decode one mapping entry. Raises `DictionaryError` if it names nothing in the dictionary that can be mapped."""
    index, subindex, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
    variable = variable_at(dictionary, index, subindex)
    where = f"mapping entry 0x{entry:08X}"
    if variable is None:
        raise DictionaryError(f"{where}: the dictionary has no object 0x{index:04X}:{subindex:02X}")
    if not variable.pdo_mappable:
        raise DictionaryError(f"{where}: 0x{index:04X}:{subindex:02X} {variable.name!r} cannot be mapped")
    mapped = MappedObject(index, subindex, _FORMATS.get(variable.data_type or 0, "x"))
    if mapped.format == "x" or mapped.entry & 0xFF != bits:
        raise DictionaryError(f"{where}: 0x{index:04X}:{subindex:02X} is not {bits} bits long in the dictionary")
    return mapped


def mapped_variable(dictionary: Dictionary, index: int, subindex: int) -> MappedObject:
    """An object of the dictionary, to be mapped whole. Raises `DictionaryError` if it cannot be."""
    variable = variable_at(dictionary, index, subindex)
    bits = len(variable) if variable is not None else 0
    return mapped_object(dictionary, index << 16 | subindex << 8 | bits)


def read_layout(dictionary: Dictionary, kind: Kind, number: int, read: Callable[[int, int], int]) -> PdoLayout:
    """One PDO of a node, by its number (from 1), enabled or not. Raises `DictionaryError` for an impossible mapping.

    `read(index, subindex)` gives the value of an object, such as its EDS default or the node's present value.
    """
    communication, mapping = COMMUNICATION[kind] + number - 1, MAPPING[kind] + number - 1
    entries = [read(mapping, 1 + position) for position in range(read(mapping, 0))]
    objects = [mapped_object(dictionary, entry) for entry in entries]
    return PdoLayout(kind, number, read(communication, 1) & COB_ID_MASK, read(communication, 2), objects)


def read_layouts(dictionary: Dictionary, kind: Kind, read: Callable[[int, int], int]) -> list[PdoLayout]:
    """The enabled PDOs of a node; `read` as for `read_layout`."""
    return [
        read_layout(dictionary, kind, number, read)
        for number in pdo_numbers(dictionary, kind)
        if not read(COMMUNICATION[kind] + number - 1, 1) & DISABLED
    ]


def pdo_numbers(dictionary: Dictionary, kind: Kind) -> Iterable[int]:
    """Numbers (from 1) of the PDOs that the dictionary describes."""
    base = COMMUNICATION[kind]
    return sorted(index - base + 1 for index in dictionary if base <= index < base + PDO_COUNT)
