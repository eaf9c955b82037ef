"""What a CANopen master sets in a cell's cards before a run: monitoring, error values, PDOs with the wired channels.

All that it relies on is among them, defaults too: a card may have others stored (0x1010). Values only, in an order that
the cards accept. Sending them is the master's business; a DCF holds what is left at last.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ..canopen.dictionary import (
    ANALOGUE_ERROR_MODE,
    ANALOGUE_ERROR_VALUE,
    CODE_SHIFT,
    CONSUMER_HEARTBEAT,
    CYCLE_PERIOD,
    DIGITAL_ERROR_MODE,
    DIGITAL_ERROR_VALUE,
    DIGITAL_FILTER_MASK,
    EMERGENCY_COB_ID,
    EMERGENCY_INHIBIT_TIME,
    ERROR_BEHAVIOUR,
    PRODUCER_HEARTBEAT,
    SYNC_OVERFLOW,
    SYNC_WINDOW,
    default_value,
    variable_at,
)
from ..canopen.frames import Cob
from ..canopen.pdo import COMMUNICATION, DISABLED, MAPPING, PdoLayout
from .model import Bus
from .wiring import BITS_A_JOINT, CardNode

TO_PRE_OPERATIONAL = 0
"""Error behaviour (0x1029:1): leave OPERATIONAL when the controller's heartbeat is lost."""
ALL_BITS = 0xFF
TIMINGS = (3, 5, 6)
"""Of a PDO: inhibit time, event timer, SYNC start value (CiA 301, 7.5.2.35, 7.5.2.37). Synchronous ones need none."""
ANALOGUE_ERROR_SHIFT = CODE_SHIFT + 16
"""An error value of 0x6444 is left-adjusted in 32 bits: the output's 16 bits are the upper ones."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One object of a card and the value that it is given."""

    index: int
    subindex: int
    value: int


def card_settings(node: CardNode, bus: Bus) -> tuple[Setting, ...]:
    """Everything that the master sets in a card, in order; a PDO is disabled first and enabled last."""
    return (
        *_heartbeat_settings(node, bus),
        *_sync_settings(node, bus),
        *_emergency_settings(node),
        Setting(ERROR_BEHAVIOUR, 1, TO_PRE_OPERATIONAL),
        *_error_settings(node),
        *(setting for layout in (*node.rpdos, *node.tpdos) for setting in _pdo_settings(node, layout)),
    )


def final_values(settings: Iterable[Setting]) -> dict[tuple[int, int], int]:
    """The value that each object has after all `settings`, by index and sub-index."""
    return {(setting.index, setting.subindex): setting.value for setting in settings}


def _heartbeat_settings(node: CardNode, bus: Bus) -> Iterator[Setting]:
    """The other entries first: a card refuses to watch a node twice (CiA 301, 7.5.2.19)."""
    others = sorted(set(node.dictionary[CONSUMER_HEARTBEAT].subindices) - {0, 1})
    yield from (Setting(CONSUMER_HEARTBEAT, other, 0) for other in others)
    yield Setting(CONSUMER_HEARTBEAT, 1, bus.controller_node_id << 16 | bus.heartbeat_timeout_ms)
    yield Setting(PRODUCER_HEARTBEAT, 0, bus.heartbeat_ms)


def _sync_settings(node: CardNode, bus: Bus) -> Iterator[Setting]:
    """The counter's overflow is fixed while the cycle period is not 0 (CiA 301, 7.5.2.22)."""
    if SYNC_OVERFLOW in node.dictionary:
        yield Setting(CYCLE_PERIOD, 0, 0)
        yield Setting(SYNC_OVERFLOW, 0, default_value(node.dictionary, SYNC_OVERFLOW))
    yield Setting(CYCLE_PERIOD, 0, bus.cycle_us)
    if SYNC_WINDOW in node.dictionary:
        yield Setting(SYNC_WINDOW, 0, 0)


def _emergency_settings(node: CardNode) -> Iterator[Setting]:
    """EMCY has to be disabled to get another COB-ID (CiA 301, 7.5.2.17)."""
    if EMERGENCY_COB_ID in node.dictionary:
        yield Setting(EMERGENCY_COB_ID, 0, DISABLED | Cob.EMERGENCY + node.card.node_id)
        yield Setting(EMERGENCY_COB_ID, 0, Cob.EMERGENCY + node.card.node_id)
    if EMERGENCY_INHIBIT_TIME in node.dictionary:
        yield Setting(EMERGENCY_INHIBIT_TIME, 0, 0)


def _error_settings(node: CardNode) -> Iterator[Setting]:
    """Every output takes its error value when the controller is lost; the cell says which."""
    values = {channel.number: channel.error_value for channel in node.card.channel}
    if DIGITAL_ERROR_MODE in node.dictionary:
        bits = sum(value << BITS_A_JOINT * (number - 1) for number, value in values.items())
        yield Setting(DIGITAL_ERROR_MODE, 1, ALL_BITS)
        yield Setting(DIGITAL_ERROR_VALUE, 1, bits)
    if DIGITAL_FILTER_MASK in node.dictionary:
        yield Setting(DIGITAL_FILTER_MASK, 1, ALL_BITS)
    if ANALOGUE_ERROR_MODE in node.dictionary:
        outputs = sorted(set(node.dictionary[ANALOGUE_ERROR_MODE].subindices) - {0})
        yield from (Setting(ANALOGUE_ERROR_MODE, output, 1) for output in outputs)
        for output in outputs:
            yield Setting(ANALOGUE_ERROR_VALUE, output, values.get(output, 0) << ANALOGUE_ERROR_SHIFT)


def _pdo_settings(node: CardNode, layout: PdoLayout) -> Iterator[Setting]:
    """Disable, map, enable (CiA 301, 7.5.2.36, 7.5.2.38)."""
    communication = COMMUNICATION[layout.kind] + layout.number - 1
    mapping = MAPPING[layout.kind] + layout.number - 1
    yield Setting(communication, 1, DISABLED | layout.cob_id)
    yield Setting(mapping, 0, 0)
    for position, mapped in enumerate(layout.objects, start=1):
        yield Setting(mapping, position, mapped.entry)
    yield Setting(mapping, 0, len(layout.objects))
    yield Setting(communication, 2, layout.transmission_type)
    for timing in TIMINGS:
        if variable_at(node.dictionary, communication, timing) is not None:
            yield Setting(communication, timing, 0)
    yield Setting(communication, 1, layout.cob_id)
