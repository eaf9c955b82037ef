"""Which cards an arm needs, in which slots, and what each channel is wired to. Nothing of timing or text."""

from collections.abc import Sequence
from dataclasses import dataclass

from .request import NewCellError

SLOTS = 7
ENCODER = "encoder"
JOINTS_A_CARD, INPUTS_A_CARD = 4, 8
"""Channels of a DAC, latch or counter card, and of an ADC card."""
USUAL_FIRST_SLOT = 2
PARTS_BITS = 8
"""Bits of the DAC0808 and the ADC0809; cards of any other resolution model no specific part."""
CONVERSION_US = 100
"""Conversion time of the ADC0809 at 640 kHz."""


@dataclass(frozen=True, slots=True)
class PlannedCard:
    """A card with the signals at its channels, from channel 1."""

    name: str
    model: str
    slot: int
    signals: tuple[str, ...]


def plan_cards(joint_names: Sequence[str], sensing: Sequence[str], bits: int) -> list[PlannedCard]:
    """DAC and latch cards for the drives, counters for encoders, ADC cards for other sensors, as few as possible.

    Sensors go round the ADC cards, positions first: all cards sample them soon after SYNC, and scan for as short as can
    be. Raises `NewCellError` if the slots do not suffice.
    """
    inputs = [f"{joint}.{kind}" for kind in sensing if kind != ENCODER for joint in joint_names]
    adc_count = -(-len(inputs) // INPUTS_A_CARD)
    drives = [joint_names[start : start + JOINTS_A_CARD] for start in range(0, len(joint_names), JOINTS_A_CARD)]
    counters = drives if ENCODER in sensing else []
    dac, adc = ("dac0808", "adc0809") if bits == PARTS_BITS else ("dac", "adc")
    wanted = [
        *_several("dac", dac, [[f"{joint}.current_command" for joint in group] for group in drives]),
        *_several("latch", "sc300", [[f"{joint}.direction" for joint in group] for group in drives]),
        *_several("counter", "encoder_counter", [[f"{joint}.{ENCODER}" for joint in group] for group in counters]),
        *_several("adc", adc, [inputs[first::adc_count] for first in range(adc_count)]),
    ]
    if len(wanted) > SLOTS:
        raise NewCellError(
            f"{len(joint_names)} joints with {len(sensing)} sensors each take {len(wanted)} cards: {len(drives)} DAC, "
            f"{len(drives)} latch, {len(counters)} counter, {adc_count} ADC; a robot has {SLOTS} slots; take fewer "
            f"sensors, such as --sensors {' '.join(sensing[:2])}"
        )
    first = min(USUAL_FIRST_SLOT, SLOTS + 1 - len(wanted))
    return [
        PlannedCard(name, model, first + place, tuple(signals)) for place, (name, model, signals) in enumerate(wanted)
    ]


def _several(name: str, model: str, groups: Sequence[Sequence[str]]) -> list[tuple[str, str, Sequence[str]]]:
    numbered = len(groups) > 1
    return [(f"{name}{place + 1}" if numbered else name, model, signals) for place, signals in enumerate(groups)]
