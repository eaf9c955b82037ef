"""When a change of an analogue input is an event (CiA 401, 0x6421 to 0x6428): limits, deltas, and what caused it.

Values are those of 0x6400 to 0x6402, left-adjusted; limits and deltas are left-adjusted 32-bit values.
"""

from canarm_protocol.canopen.dictionary import (
    ANALOGUE_INPUT,
    ANALOGUE_INPUT_8,
    ANALOGUE_INPUT_32,
    DELTA,
    INTERRUPT_ENABLE,
    LOWER_LIMIT,
    NEGATIVE_DELTA,
    POSITIVE_DELTA,
    TRIGGER_SELECTION,
    UPPER_LIMIT,
)

from .store import ObjectStore

ABOVE_UPPER, BELOW_LOWER, CHANGED, REDUCED, INCREASED = 0x01, 0x02, 0x04, 0x08, 0x10
"""Bits of 0x6421."""
LIMITS, DELTAS = ABOVE_UPPER | BELOW_LOWER, CHANGED | REDUCED | INCREASED
SHIFT = {ANALOGUE_INPUT_8: 24, ANALOGUE_INPUT: 16, ANALOGUE_INPUT_32: 0}
"""Shift from the value of an input to 32 bits."""


class AnalogueEvents:
    """Compares inputs with their last transmitted values."""

    def __init__(self, store: ObjectStore) -> None:
        self._store = store
        self._told: dict[tuple[int, int], int] = {}
        self._sources = 0

    def reset(self) -> None:
        """No value has been transmitted yet."""
        self._told.clear()
        self._sources = 0

    @property
    def is_enabled(self) -> bool:
        """0x6423."""
        return bool(self._store.number(INTERRUPT_ENABLE))

    @staticmethod
    def covers(index: int) -> bool:
        """Whether an object is an analogue input."""
        return index in SHIFT

    def take_sources(self) -> int:
        """0x6422:1: a bit for each channel that caused an event; reading clears them."""
        sources, self._sources = self._sources, 0
        return sources

    def told(self, index: int, subindex: int, value: int) -> None:
        """A TPDO has carried the value: deltas count from it."""
        self._told[index, subindex] = value

    def happens(self, index: int, subindex: int, value: int) -> bool:
        """Whether the value is an event by the criteria that are selected: a change, a limit, a delta."""
        is_event = self._is_event(index, subindex, value)
        if is_event:
            self._sources |= 1 << (subindex - 1)
        return is_event

    def _is_event(self, index: int, subindex: int, value: int) -> bool:
        number, told = self._store.number, self._told.get((index, subindex))
        selected = number(TRIGGER_SELECTION, subindex)
        if told == value or not selected:
            return False
        scaled = value << SHIFT[index]
        if selected & LIMITS and not (
            (selected & ABOVE_UPPER and scaled >= number(UPPER_LIMIT, subindex))
            or (selected & BELOW_LOWER and scaled < number(LOWER_LIMIT, subindex))
        ):
            return False
        if told is None or not selected & DELTAS:
            return True
        change = scaled - (told << SHIFT[index])
        return bool(
            (selected & CHANGED and abs(change) > number(DELTA, subindex))
            or (selected & REDUCED and -change > number(NEGATIVE_DELTA, subindex))
            or (selected & INCREASED and change > number(POSITIVE_DELTA, subindex))
        )
