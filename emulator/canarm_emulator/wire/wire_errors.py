"""What can go wrong in a transmission: collisions, injected disturbances, missing acknowledgement.

Predicts a transmission from its senders and receivers. Counters, queues and the order of transmissions are in `wire`,
lengths of flags and the rules of counting in `confinement`.
"""

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.transport.bits import TAIL_BITS, arbitration_bits, wire_bits

from .confinement import DELIMITER_BITS, ErrorKind, Signal, bit_error, collision, local_crc_error, no_acknowledge
from .wire_node import Waiting, WireNode

Identifier = tuple[int, bool]
"""Identifier of a frame, and whether it is extended."""
Sender = tuple[WireNode, Waiting]


@dataclass(slots=True)
class Disturbance:
    """Future transmissions of an identifier that fail: `times` of them, after `spare` good ones.

    With `bit` the transmitter itself finds that bit inverted (counted from the end of the arbitration field with stuff
    bits, the last bit of the CRC at most). Otherwise the named `receivers` (None: all) find a CRC error, or nobody
    acknowledges.
    """

    spare: int
    times: int
    receivers: frozenset[Hashable] | None
    bit: int | None
    is_unacknowledged: bool = False


@dataclass(slots=True)
class Attempt:
    """One planned transmission, from SOF to the end of the frame or of the error delimiter."""

    start_ns: int
    end_ns: int
    transmitters: list[Sender]
    losers: Sequence[WireNode] = ()
    kind: ErrorKind | None = None
    signal: Signal | None = None
    faulty: Sequence[WireNode] = ()
    """Receivers that find a CRC error by themselves."""
    beaten: Sequence[Sender] = ()
    """Error-passive transmitters of another frame with the same identifier: their bit error disturbs nobody."""
    disturbance: Disturbance | None = None
    """The injected disturbance that hits it."""

    @property
    def senders(self) -> list[Sender]:
        """All nodes that send until the end, or until an error of their own."""
        return [*self.transmitters, *self.beaten]

    def spoil(self, kind: ErrorKind, signal: Signal, bit_ns: int) -> None:
        """The transmission will end in an error frame."""
        self.kind, self.signal = kind, signal
        self.end_ns = self.start_ns + (signal.flag_to + DELIMITER_BITS) * bit_ns


class Disturbances:
    """Disturbances that wait for their transmission."""

    def __init__(self) -> None:
        self._pending: dict[Identifier, list[Disturbance]] = {}

    def __bool__(self) -> bool:
        return bool(self._pending)

    def add(self, identifier: Identifier, disturbance: Disturbance) -> None:
        """Wait for transmissions of `identifier`."""
        self._pending.setdefault(identifier, []).append(disturbance)

    def next(self, frame: Frame) -> Disturbance | None:
        """What hits the next transmission of a frame with this identifier."""
        pending = self._pending.get((frame.can_id, frame.is_extended), ())
        return next((each for each in pending if not each.spare), None)

    def withdraw(self, disturbance: Disturbance) -> None:
        """Forget a disturbance, if it has not all happened."""
        for identifier, pending in list(self._pending.items()):
            left = [each for each in pending if each is not disturbance]
            if left:
                self._pending[identifier] = left
            else:
                del self._pending[identifier]

    def count(self, frame: Frame) -> None:
        """A transmission with this identifier begins."""
        pending = self._pending.get((frame.can_id, frame.is_extended))
        if pending is None:
            return
        hit = self.next(frame)
        for each in pending:
            each.spare -= each.spare > 0
        if hit is not None:
            hit.times -= 1
            if not hit.times:
                self.withdraw(hit)
                return
        if not pending:
            del self._pending[(frame.can_id, frame.is_extended)]


def foresee(attempt: Attempt, nodes: Iterable[WireNode], disturbance: Disturbance | None, bit_ns: int) -> None:
    """Work out how `attempt` ends among `nodes`."""
    if _collide(attempt, bit_ns):
        return
    senders = {node for node, _ in attempt.senders}
    receivers = [node for node in nodes if node not in senders and node.is_on_bus]
    transmitter, waiting = attempt.transmitters[0]
    if disturbance is not None and disturbance.bit is not None:
        sent = wire_bits(waiting.frame)
        index = min(arbitration_bits(waiting.frame) + disturbance.bit, waiting.bits - TAIL_BITS - 1)
        monitored = sent[:index] + ("1" if sent[index] == "0" else "0")
        signal = bit_error(monitored, transmitter.is_active, any(node.is_active for node in receivers))
        attempt.spoil(ErrorKind.BIT, signal, bit_ns)
        return
    if disturbance is not None and disturbance.is_unacknowledged:
        attempt.spoil(ErrorKind.ACK, no_acknowledge(waiting.bits, transmitter.is_active, False), bit_ns)
        return
    if disturbance is not None:
        chosen = disturbance.receivers
        attempt.faulty = [node for node in receivers if chosen is None or node.name in chosen]
    sound = [node for node in receivers if node not in attempt.faulty]
    any_flag = any(node.is_active for node in attempt.faulty)
    if not sound:
        kind = ErrorKind.CRC if attempt.faulty else ErrorKind.ACK
        attempt.spoil(kind, no_acknowledge(waiting.bits, transmitter.is_active, any_flag), bit_ns)
    elif any_flag:
        any_other = transmitter.is_active or any(node.is_active for node in sound)
        attempt.spoil(ErrorKind.CRC, local_crc_error(waiting.bits, any_other), bit_ns)


def _collide(attempt: Attempt, bit_ns: int) -> bool:
    """Whether frames of several nodes with the same identifier destroy each other.

    A node that sends recessive where another sends dominant finds a bit error. If it is error-passive, its recessive
    flag leaves the other's frame intact.
    """
    while len(attempt.transmitters) > 1:
        streams = {node: wire_bits(waiting.frame) for node, waiting in attempt.transmitters}
        index = collision(streams.values())
        if index is None:
            return False
        finders = [each for each in attempt.transmitters if streams[each[0]][index] == "1"]
        if any(node.is_active for node, _ in finders):
            monitored = next(iter(streams.values()))[:index] + "0"
            attempt.spoil(ErrorKind.BIT, bit_error(monitored, True, True), bit_ns)
            return True
        attempt.beaten = [*attempt.beaten, *finders]
        attempt.transmitters = [each for each in attempt.transmitters if each not in finders]
        attempt.end_ns = attempt.start_ns + attempt.transmitters[0][1].bits * bit_ns
    return False
