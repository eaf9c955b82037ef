"""Faults of the bus as a wire. They need the wire model, which counts and recovers as ISO 11898-1 says."""

from dataclasses import dataclass

from ...wire import Wire
from ..declaration import BusFault, Family, TapKind, parameter

_BUS = (TapKind.BUS,)
UNTIL_BUS_OFF = 32
"""Errors in a row, 8 each, that bring a transmit error counter from 0 to 256."""


def _identifier(about: str) -> int:
    value: int = parameter(about, "", 0x194, 1, 0x7FF, is_whole=True)
    return value


@dataclass
class ErrorFrames(BusFault, name="error-frames", family=Family.BUS, acts_on=_BUS, needs_wire=True):
    """Transmissions of an identifier are hit by a bit error, and sent again."""

    cob_id: int = _identifier("which identifier")
    count: int = parameter("how many transmissions in a row, every cycle", "", 1, 1, 15, is_whole=True)

    def act(self, wire: Wire, now_ns: int) -> None:
        """The next ones."""
        wire.corrupt(self.cob_id, times=self.count, bit=8)


@dataclass
class _Burst(BusFault):
    """As many errors in a row as bring a node off the bus, once."""

    cob_id: int = _identifier("an identifier that the node sends")
    _has_acted: bool = False

    def act(self, wire: Wire, now_ns: int) -> None:
        """Once."""
        if not self._has_acted:
            self._has_acted = True
            self.strike(wire)

    def strike(self, wire: Wire) -> None:
        """What it does."""
        raise NotImplementedError


@dataclass
class BusOff(_Burst, name="bus-off", family=Family.BUS, acts_on=_BUS, needs_wire=True):
    """A node's transmissions fail until it is off the bus; it recovers as its controller does."""

    def strike(self, wire: Wire) -> None:
        """32 bit errors."""
        wire.corrupt(self.cob_id, times=UNTIL_BUS_OFF, bit=8)


@dataclass
class NoAcknowledge(BusFault, name="no-ack", family=Family.BUS, acts_on=_BUS, needs_wire=True):
    """Nobody acknowledges the frames of an identifier: they are sent again and again."""

    cob_id: int = _identifier("which identifier")
    count: int = parameter("how many transmissions in a row, every cycle", "", 1, 1, 15, is_whole=True)

    def act(self, wire: Wire, now_ns: int) -> None:
        """The next ones."""
        wire.corrupt(self.cob_id, times=self.count, is_unacknowledged=True)
