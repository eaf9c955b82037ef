"""What a CANopen master sets in a cell's cards before a run: monitoring, error values, PDOs with the wired channels.

The settings include every object that the master relies on, even at its default: a card may have stored another value
(0x1010). Values only, in an order that the cards accept. The master sends them; a DCF holds the final values.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ..canopen.dictionary import (
    CONSUMER_HEARTBEAT,
    CYCLE_PERIOD,
    EMERGENCY_COB_ID,
    EMERGENCY_INHIBIT_TIME,
    ERROR_BEHAVIOUR,
    PRODUCER_HEARTBEAT,
    SYNC_OVERFLOW,
    SYNC_WINDOW,
    variable_at,
)
from ..canopen.frames import Cob
from ..canopen.pdo import COMMUNICATION, DISABLED, MAPPING, PdoLayout
from .model import Bus
from .wiring import CardNode

SYNC_COUNTER = 240
"""The counter of our own masters' SYNC goes from 1 to this (0x1019); by default a card expects none."""
TO_PRE_OPERATIONAL = 0
"""Error behaviour (0x1029:1): leave OPERATIONAL when the controller's heartbeat is lost."""
TIMINGS = (3, 5, 6)
"""Inhibit time, event timer and SYNC start value of a PDO (CiA 301, 7.5.2.35, 7.5.2.37); synchronous PDOs need none."""


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
        *_application_settings(node),
        *(Setting(COMMUNICATION[each.kind] + each.number - 1, 1, DISABLED | each.cob_id) for each in node.unused),
        *(setting for layout in (*node.rpdos, *node.tpdos) for setting in _pdo_settings(node, layout)),
    )


def final_values(settings: Iterable[Setting]) -> dict[tuple[int, int], int]:
    """The value that each object has after all `settings`, by index and sub-index."""
    return {(setting.index, setting.subindex): setting.value for setting in settings}


def _heartbeat_settings(node: CardNode, bus: Bus) -> Iterator[Setting]:
    """Other entries are cleared first: a card refuses to watch a node twice (CiA 301, 7.5.2.19)."""
    others = sorted(set(node.dictionary[CONSUMER_HEARTBEAT].subindices) - {0, 1})
    yield from (Setting(CONSUMER_HEARTBEAT, other, 0) for other in others)
    yield Setting(CONSUMER_HEARTBEAT, 1, bus.controller_node_id << 16 | bus.heartbeat_timeout_ms)
    yield Setting(PRODUCER_HEARTBEAT, 0, bus.heartbeat_ms)


def _sync_settings(node: CardNode, bus: Bus) -> Iterator[Setting]:
    """The counter's overflow is fixed while the cycle period is not 0 (CiA 301, 7.5.2.22)."""
    if SYNC_OVERFLOW in node.dictionary:
        yield Setting(CYCLE_PERIOD, 0, 0)
        yield Setting(SYNC_OVERFLOW, 0, SYNC_COUNTER)
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


def _application_settings(node: CardNode) -> Iterator[Setting]:
    """Objects of the card's kind, with the cell's error values."""
    card = node.card
    error_values = {channel.number: None if node.keeps_outputs else channel.error_value for channel in card.channel}
    for index, subindex, value in card.kind.application_values(card, node.dictionary, error_values):
        yield Setting(index, subindex, value)


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
