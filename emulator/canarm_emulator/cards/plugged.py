"""A card in its slot: what its analogue side is connected to, and what the rack gets back for plugging it in.

Knows no particular kind: the module of a kind is found by its name.
"""

import importlib
from collections.abc import Callable
from dataclasses import dataclass

from canarm_protocol.cell.model import Card

from ..node.io_device import IoDevice
from ..robot.truth import AdcTruth, DacTruth
from ..signals import Distortion
from .registers import Clock, RegisterCard

Samples = tuple[tuple[int, int, int], ...]
"""What a card samples in a scan, in order of time: channel (from 0), ns after the begin, and place among the values."""
Scan = Callable[[int, Samples, list[float]], None]
"""Make the accesses of a program that scans the inputs, from a time on (ns); `values` are what stood at the pins."""


@dataclass(frozen=True, slots=True)
class Connections:
    """What a card of either direction is connected to; channels count from 0."""

    clock: Clock
    set_output: Callable[[int, float], None]
    """An output of a channel has changed: I_out/I_ref of a DAC, the two bits of a latch."""
    sample: Callable[[int], float]
    """What stands at the pin of an input channel now: V at a converter, rad of the encoder's shaft at a counter."""
    full_scale_v: float
    """The reference voltage of a converter."""
    lines: Callable[[int], int]
    """Periods per turn of the encoder at a channel of a counter; 0 where there is none."""
    adc: AdcTruth
    dac: DacTruth


@dataclass(frozen=True, slots=True)
class Plugged:
    """A card as registers and as a device, and where faults reach the code of a channel (from 0)."""

    registers: RegisterCard
    device: IoDevice
    distort: Callable[[int, Distortion | None], None]
    """Change the code of a channel, or no longer (None)."""
    refresh: Callable[[int], None] | None = None
    """Let an output pass its code on once more; None where there are no outputs."""
    inputs: frozenset[int] = frozenset()
    """Indices of the objects that have an input channel under each sub-index; mapping one in a TPDO has it scanned."""
    scan: Scan | None = None


def plug_in(card: Card, connections: Connections) -> Plugged:
    """A card of the kind that `card` names."""
    plugged = importlib.import_module(f".{card.model}", __package__).plug_in(card, connections)
    assert isinstance(plugged, Plugged)
    return plugged
