"""Faults of the bus as a wire. They need the wire model, which counts and recovers as ISO 11898-1 says."""

from dataclasses import dataclass
from typing import ClassVar

from ...wire.confinement import BUS_OFF_LIMIT, ERROR_STEP
from ...wire.wire import Wire
from ...wire.wire_errors import Disturbance
from ..declaration import BusFault, Family, TapKind
from ..parameters import parameter

_BUS = (TapKind.BUS,)
UNTIL_BUS_OFF = -(-(BUS_OFF_LIMIT + 1) // ERROR_STEP)
"""Errors in a row, 8 each, that bring a transmit error counter from 0 to 256."""
BIT = 8
"""The bit that is hit: IDE, r0 and DLC take six after the arbitration field, so this is in the data or the CRC."""


@dataclass
class _Disturbing(BusFault):
    """A fault on the transmissions of an identifier; its end withdraws what has not happened yet."""

    cob_id: int = parameter("which identifier", "", 0x294, 1, 0x7FF, is_whole=True)
    _pending: Disturbance | None = None

    def end(self, wire: Wire) -> None:
        """Let pass what was still to be hit."""
        if self._pending is not None:
            wire.withdraw(self._pending)
            self._pending = None


@dataclass
class _EveryCycle(_Disturbing):
    """A number of transmissions fail in every cycle; it is not carried over from cycles without any."""

    hits_the_ack_slot: ClassVar[bool]
    count: int = parameter("how many transmissions in a row, every cycle", "", 1, 1, 15, is_whole=True)

    def act(self, wire: Wire, now_ns: int) -> None:
        """The next ones."""
        self.end(wire)
        if self.hits_the_ack_slot:
            self._pending = wire.corrupt(self.cob_id, times=self.count, is_unacknowledged=True)
        else:
            self._pending = wire.corrupt(self.cob_id, times=self.count, bit=BIT)


@dataclass
class ErrorFrames(_EveryCycle, name="error-frames", family=Family.BUS, acts_on=_BUS, needs_wire=True):
    """Transmissions of an identifier are hit by a bit error, and sent again."""

    hits_the_ack_slot = False


@dataclass
class NoAcknowledge(_EveryCycle, name="no-ack", family=Family.BUS, acts_on=_BUS, needs_wire=True):
    """Nobody acknowledges frames of an identifier, and they are sent again."""

    hits_the_ack_slot = True


@dataclass
class BusOff(_Disturbing, name="bus-off", family=Family.BUS, acts_on=_BUS, needs_wire=True):
    """The transmissions of an identifier fail until its sender is off the bus; it recovers as its controller does."""

    _has_acted: bool = False

    def act(self, wire: Wire, now_ns: int) -> None:
        """32 bit errors in a row, once; the sender's bus-off ends the row."""
        if not self._has_acted:
            self._has_acted = True
            self._pending = wire.corrupt(self.cob_id, times=UNTIL_BUS_OFF, bit=BIT)
