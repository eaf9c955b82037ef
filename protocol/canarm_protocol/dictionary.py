"""Object dictionaries of the cards, read from their EDS files."""

import io
from importlib import resources
from typing import Any

import canopen
from canopen.objectdictionary import ODVariable

from .cell import CardModel
from .errors import DictionaryError

Dictionary = Any
"""A `canopen.ObjectDictionary`; the library ships no types."""

DEVICE_TYPE, ERROR_REGISTER, ERROR_HISTORY, SYNC_COB_ID, CYCLE_PERIOD = 0x1000, 0x1001, 0x1003, 0x1005, 0x1006
CONSUMER_HEARTBEAT, PRODUCER_HEARTBEAT, IDENTITY, SYNC_OVERFLOW = 0x1016, 0x1017, 0x1018, 0x1019
ERROR_BEHAVIOUR = 0x1029
CLOCK_MODE = 0x2000
DIGITAL_OUTPUT, DIGITAL_ERROR_MODE, DIGITAL_ERROR_VALUE = 0x6200, 0x6206, 0x6207
ANALOGUE_INPUT, ANALOGUE_OUTPUT, ANALOGUE_ERROR_MODE, ANALOGUE_ERROR_VALUE = 0x6401, 0x6411, 0x6443, 0x6444

CODE_SHIFT = 7
"""An 8-bit code c travels as c << 7 in CiA 401's signed, left-adjusted 16 bits: the sign bit is 0, no bit is lost."""


def eds_text(model: CardModel) -> str:
    """The EDS file of a card model."""
    return (resources.files(__package__) / "eds" / f"{model}.eds").read_text(encoding="ascii")


def load_dictionary(model: CardModel, node_id: int) -> Dictionary:
    """The object dictionary of a card as a node: `$NODEID` in the EDS stands for `node_id`."""
    return canopen.import_od(_named(eds_text(model), f"{model}.eds"), node_id)


def variable_at(dictionary: Dictionary, index: int, subindex: int) -> ODVariable | None:
    """The object at exactly this index and sub-index; the library's own look-up makes up members of arrays."""
    entry = dictionary.get(index)
    if isinstance(entry, ODVariable):
        return None if subindex else entry
    return entry.subindices.get(subindex) if entry is not None else None


def default_value(dictionary: Dictionary, index: int, subindex: int = 0) -> int:
    """The default of a numeric object. Raises `DictionaryError` where the EDS gives none."""
    variable = variable_at(dictionary, index, subindex)
    if variable is None or variable.default is None:
        raise DictionaryError(f"EDS: 0x{index:04X}:{subindex:02X} has no DefaultValue; give it one")
    return int(variable.default)


def _named(text: str, name: str) -> io.StringIO:
    source = io.StringIO(text)
    source.name = name
    return source
