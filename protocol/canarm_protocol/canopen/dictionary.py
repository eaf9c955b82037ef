"""Object dictionaries of the cards, read from their EDS files."""

import functools
import io
from importlib import resources
from typing import Any

import canopen
from canopen.objectdictionary import ODVariable

from ..errors import DictionaryError

Dictionary = Any
"""A `canopen.ObjectDictionary`; the library ships no types."""

DEVICE_TYPE, ERROR_REGISTER, ERROR_HISTORY, SYNC_COB_ID, CYCLE_PERIOD = 0x1000, 0x1001, 0x1003, 0x1005, 0x1006
SYNC_WINDOW, STORE_PARAMETERS, RESTORE_DEFAULTS = 0x1007, 0x1010, 0x1011
GUARD_TIME, LIFE_TIME_FACTOR, STORED_EDS, STORED_EDS_FORMAT = 0x100C, 0x100D, 0x1021, 0x1022
EMERGENCY_COB_ID, EMERGENCY_INHIBIT_TIME = 0x1014, 0x1015
CONSUMER_HEARTBEAT, PRODUCER_HEARTBEAT, IDENTITY, SYNC_OVERFLOW = 0x1016, 0x1017, 0x1018, 0x1019
ERROR_BEHAVIOUR = 0x1029
CLOCK_MODE, SCAN_PERIOD = 0x2000, 0x2010
DIGITAL_OUTPUT, DIGITAL_ERROR_MODE, DIGITAL_ERROR_VALUE, DIGITAL_FILTER_MASK = 0x6200, 0x6206, 0x6207, 0x6208
ANALOGUE_INPUT, ANALOGUE_OUTPUT, ANALOGUE_ERROR_MODE, ANALOGUE_ERROR_VALUE = 0x6401, 0x6411, 0x6443, 0x6444
ANALOGUE_INPUT_8, ANALOGUE_OUTPUT_8, ANALOGUE_INPUT_32, ANALOGUE_OUTPUT_32 = 0x6400, 0x6410, 0x6402, 0x6412
TRIGGER_SELECTION, INTERRUPT_SOURCE, INTERRUPT_ENABLE = 0x6421, 0x6422, 0x6423
UPPER_LIMIT, LOWER_LIMIT, DELTA, NEGATIVE_DELTA, POSITIVE_DELTA = 0x6424, 0x6425, 0x6426, 0x6427, 0x6428


@functools.cache
def eds_text(model: str) -> str:
    """The EDS file of a kind of card, by its name."""
    return (resources.files("canarm_protocol") / "eds" / f"{model}.eds").read_text(encoding="ascii")


@functools.cache
def load_dictionary(model: str, node_id: int) -> Dictionary:
    """The object dictionary of a card as a node: `$NODEID` in the EDS stands for `node_id`.

    It is read once, which takes longer than a second of a run, and is the same for everybody: nobody may change it.
    """
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
