"""What a CANopen master sets in a cell's cards before a run: monitoring, error values, PDOs with the wired channels.

Values only, in an order that the cards accept. Sending them is the master's business; a DCF holds what is left at last.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from .cell import Bus
from .dictionary import (
    ANALOGUE_ERROR_MODE,
    ANALOGUE_ERROR_VALUE,
    CODE_SHIFT,
    CONSUMER_HEARTBEAT,
    CYCLE_PERIOD,
    DIGITAL_ERROR_MODE,
    DIGITAL_ERROR_VALUE,
    ERROR_BEHAVIOUR,
    PRODUCER_HEARTBEAT,
)
from .pdo import COMMUNICATION, DISABLED, MAPPING, PdoLayout
from .wiring import BITS_A_JOINT, CardNode

TO_PRE_OPERATIONAL = 0
"""Error behaviour (0x1029:1): leave OPERATIONAL when the controller's heartbeat is lost."""
ALL_BITS = 0xFF
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
        Setting(CONSUMER_HEARTBEAT, 1, bus.controller_node_id << 16 | bus.heartbeat_timeout_ms),
        Setting(PRODUCER_HEARTBEAT, 0, bus.heartbeat_ms),
        Setting(CYCLE_PERIOD, 0, bus.cycle_us),
        Setting(ERROR_BEHAVIOUR, 1, TO_PRE_OPERATIONAL),
        *_error_settings(node),
        *(setting for layout in (*node.rpdos, *node.tpdos) for setting in _pdo_settings(layout)),
    )


def final_values(settings: tuple[Setting, ...]) -> dict[tuple[int, int], int]:
    """The value that each object has after all `settings`, by index and sub-index."""
    return {(setting.index, setting.subindex): setting.value for setting in settings}


def _error_settings(node: CardNode) -> Iterator[Setting]:
    """Every output takes its error value when the controller is lost; the cell says which."""
    values = {channel.number: channel.error_value for channel in node.card.channel}
    if DIGITAL_ERROR_MODE in node.dictionary:
        bits = sum(value << BITS_A_JOINT * (number - 1) for number, value in values.items())
        yield Setting(DIGITAL_ERROR_MODE, 1, ALL_BITS)
        yield Setting(DIGITAL_ERROR_VALUE, 1, bits)
    if ANALOGUE_ERROR_MODE in node.dictionary:
        outputs = sorted(set(node.dictionary[ANALOGUE_ERROR_MODE].subindices) - {0})
        yield from (Setting(ANALOGUE_ERROR_MODE, output, 1) for output in outputs)
        for output in outputs:
            yield Setting(ANALOGUE_ERROR_VALUE, output, values.get(output, 0) << ANALOGUE_ERROR_SHIFT)


def _pdo_settings(layout: PdoLayout) -> Iterator[Setting]:
    """Disable, map, enable (CiA 301, 7.5.2.36, 7.5.2.38)."""
    communication = COMMUNICATION[layout.kind] + layout.number - 1
    mapping = MAPPING[layout.kind] + layout.number - 1
    yield Setting(communication, 1, DISABLED | layout.cob_id)
    yield Setting(mapping, 0, 0)
    for position, mapped in enumerate(layout.objects, start=1):
        yield Setting(mapping, position, mapped.entry)
    yield Setting(mapping, 0, len(layout.objects))
    yield Setting(communication, 2, layout.transmission_type)
    yield Setting(communication, 1, layout.cob_id)
