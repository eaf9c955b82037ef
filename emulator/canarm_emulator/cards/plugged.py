"""A card in its slot: what its analogue side is connected to, and what the rack gets when it plugs it in.

The module of a kind is found by its name; no particular kind is known here.
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
"""The samples of a card in a scan, in order of time: channel (from 0), ns after the start, and index of the value."""
Scan = Callable[[int, Samples, list[float]], None]
"""Makes the accesses of a program that scans the inputs, from a time (ns) on; the values are those at the pins."""


@dataclass(frozen=True, slots=True)
class Connections:
    """What a card of either direction is connected to; channels count from 0."""

    clock: Clock
    set_output: Callable[[int, float], None]
    """An output of a channel has changed: I_out/I_ref of a DAC, the two bits of a latch."""
    sample: Callable[[int], float]
    """The present input of a channel: V at a converter, rad of the encoder's shaft at a counter."""
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
    """Put out a channel's code again; None if there are no outputs."""
    inputs: frozenset[int] = frozenset()
    """Indices of the objects with an input channel under each sub-index; mapped ones are scanned."""
    scan: Scan | None = None


def plug_in(card: Card, connections: Connections) -> Plugged:
    """A card of the kind that `card` names."""
    plugged = importlib.import_module(f".{card.model}", __package__).plug_in(card, connections)
    assert isinstance(plugged, Plugged)
    return plugged
