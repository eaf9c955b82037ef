"""Fault confinement of CAN nodes: error counters and states, and how errors are signalled on the bus (ISO 11898-1).

Only rules about counts of bits and error states. Time, queues and arbitration never enter.

The letters a) to l) are those of the counting rules of ISO 11898-1:2015, 12.1.4.2 (rules 1 to 12 of CAN 2.0, section
8). Not modelled: overload frames, an error flag that is itself disturbed (rules d, e), a bus that stays dominant
(rule f).
"""

from collections.abc import Collection
from enum import Enum
from typing import NamedTuple

from canarm_protocol.transport.bits import ACK_DELIMITER_BITS, END_OF_FRAME_BITS

FLAG_BITS = 6
DELIMITER_BITS = 8
SUSPEND_BITS = 8
"""Recessive bits after intermission that an error-passive node waits before it transmits again."""
RECOVERY_SEQUENCES, RECESSIVE_SEQUENCE_BITS = 128, 11
"""Recessive sequences that a node in bus-off must monitor before it takes part again (rule l)."""
STUFF_ERROR_RUN = 6
ERROR_STEP = 8
PASSIVE_LIMIT, BUS_OFF_LIMIT = 127, 255
REC_AFTER_SUCCESS = 119
"""Rule h: a REC above 127 becomes a value from 119 to 127 with the next reception."""
REC_MAXIMUM = 255
"""The counter is a byte in common controllers and stops there."""


class ErrorState(Enum):
    """The state of a node's error counters (rules i, j, k)."""

    ACTIVE = "error-active"
    PASSIVE = "error-passive"
    BUS_OFF = "bus-off"


class ErrorKind(Enum):
    """The error that ended a transmission."""

    CRC = "CRC error"
    ACK = "ACK error"
    BIT = "bit error"


class Counters:
    """Error counters and error state of one node."""

    __slots__ = ("rec", "state", "tec")

    def __init__(self) -> None:
        self.tec = 0
        """Transmit error counter."""
        self.rec = 0
        """Receive error counter."""
        self.state = ErrorState.ACTIVE

    @property
    def is_active(self) -> bool:
        """Whether the node signals errors by dominant bits."""
        return self.state is ErrorState.ACTIVE

    def transmit_error(self) -> None:
        """Rule c: the transmitter has sent an error flag."""
        self.tec += ERROR_STEP
        self._judge()

    def receive_error(self, flag_was_followed_by_dominant: bool) -> None:
        """Rule a; with rule b when the first bit after the node's own flag was dominant: it saw the error first."""
        self.rec = min(self.rec + 1 + ERROR_STEP * flag_was_followed_by_dominant, REC_MAXIMUM)
        self._judge()

    def transmitted(self) -> None:
        """Rule g: a frame was sent and acknowledged."""
        if self.tec:
            self.tec -= 1
            self._judge()

    def received(self) -> None:
        """Rule h: a frame was received without error."""
        if self.rec:
            self.rec = self.rec - 1 if self.rec <= PASSIVE_LIMIT else REC_AFTER_SUCCESS
            self._judge()

    def reset(self) -> None:
        """Rule l: back from bus-off."""
        self.tec = self.rec = 0
        self.state = ErrorState.ACTIVE

    def _judge(self) -> None:
        if self.tec > BUS_OFF_LIMIT:
            self.state = ErrorState.BUS_OFF
        elif self.tec > PASSIVE_LIMIT or self.rec > PASSIVE_LIMIT:
            self.state = ErrorState.PASSIVE
        else:
            self.state = ErrorState.ACTIVE


class Signal(NamedTuple):
    """How an error appears on the bus, in bits from SOF, and whose counters it changes."""

    flag_from: int
    """First bit of the superposed error flags."""
    flag_to: int
    """The bit after them: the error delimiter begins."""
    counts_for_transmitter: bool
    """False for an error-passive node alone on the bus (rule c, exception 1)."""
    first_to_see_suffer: bool
    """Whether the receivers that detect the error first see others' flags after their own (rule b)."""


def no_acknowledge(frame_bits: int, transmitter_is_active: bool, any_receiver_is_active: bool) -> Signal:
    """Nobody acknowledges: there are no receivers, or all of them have found a CRC error.

    An error-active transmitter sends its flag from the ACK delimiter on. Receivers with a CRC error send theirs from
    the next bit on, so that the flags superpose to seven bits; an error-passive transmitter's recessive flag ends with
    theirs.
    """
    end_of_frame = frame_bits - END_OF_FRAME_BITS
    ack_delimiter = end_of_frame - ACK_DELIMITER_BITS
    if any_receiver_is_active:
        flag_from = ack_delimiter if transmitter_is_active else end_of_frame
        return Signal(flag_from, end_of_frame + FLAG_BITS, True, False)
    return Signal(ack_delimiter, ack_delimiter + FLAG_BITS, transmitter_is_active, False)


def local_crc_error(frame_bits: int, any_other_is_active: bool) -> Signal:
    """Some receivers, at least one of them error-active, find a CRC error in a frame that others acknowledge.

    They send their flags from the bit after the ACK delimiter on; all others see a dominant bit and send theirs from
    the next one on.
    """
    end_of_frame = frame_bits - END_OF_FRAME_BITS
    return Signal(end_of_frame, end_of_frame + FLAG_BITS + any_other_is_active, True, any_other_is_active)


def bit_error(bits: str, transmitter_is_active: bool, any_receiver_is_active: bool) -> Signal:
    """The transmitter monitors another value than it sent in the last of `bits`, and sends its flag from the next on.

    The receivers detect the error at the sixth equal bit and answer with their own flags: 6 to 12 bits superposed.
    """
    flag_from = len(bits)
    length = FLAG_BITS
    if any_receiver_is_active and not is_stuff_error(bits):
        flag_bit = "0" if transmitter_is_active else "1"
        length += STUFF_ERROR_RUN - (len(bits) - len(bits.rstrip(flag_bit)))
    return Signal(flag_from, flag_from + length, True, False)


def is_stuff_error(bits: str) -> bool:
    """Whether the last six of `bits` are equal: every receiver detects the error at once."""
    return bits[-STUFF_ERROR_RUN:] in ("0" * STUFF_ERROR_RUN, "1" * STUFF_ERROR_RUN)


def collision(streams: Collection[str]) -> int | None:
    """Index of the first bit in which frames that won arbitration together differ; None if they are equal."""
    for index, bits in enumerate(zip(*streams, strict=False)):
        if len(set(bits)) > 1:
            return index
    return None
