"""Which client has which SDO channel of the bench node: claims, their end by silence, and who may speak on a channel.

A client writes a token, a number of its own that is not 0, to CHANNEL_OWNER:n over the channel that is for claims, and
reads it back: the channel is its own if it reads its own token. It writes 0 over the channel itself to give it back.
A channel that nobody has claimed serves whoever asks.
"""

from dataclasses import dataclass

from canarm_protocol.canopen.sdo import AbortCode
from canarm_protocol.cell.bench_objects import CLAIM_CHANNEL, CLAIM_S, CLIENT_CHANNELS, SDO_CHANNELS, sdo_channel

from ..node.store import SdoRefused

CLAIM_NS = int(CLAIM_S * 1e9)
NOBODY = 0


@dataclass(slots=True)
class _Channel:
    token: int = NOBODY
    origin: object = None
    heard_ns: int = -CLAIM_NS
    """When somebody last asked for something, on the clock that the runner sets."""


class SdoChannels:
    """The channels of one bench node. `now_ns` is a clock of the clients' world, set by whoever drives the bench."""

    def __init__(self, node_id: int) -> None:
        self.now_ns = 0
        self.current = 0
        """The channel of the request that is being served."""
        self.ignored = 0
        """Requests on a channel that belongs to another client."""
        self._origin: object = None
        self._channels = [_Channel() for _ in range(SDO_CHANNELS + 1)]
        self._numbers = {sdo_channel(node_id, number)[0]: number for number in range(SDO_CHANNELS + 1)}

    def admit(self, cob_id: int, origin: object) -> bool:
        """A frame comes: whether it is to be served. False for one from a stranger on a claimed channel."""
        number = self._numbers.get(cob_id)
        if number is None:
            return True
        channel = self._channels[number]
        if channel.token != NOBODY and channel.origin != origin:
            self.ignored += 1
            return False
        channel.heard_ns = self.now_ns
        self.current, self._origin = number, origin
        return True

    def owner(self, number: int) -> int:
        """The token of the client that has claimed channel `number`, or 0."""
        return self._channels[number].token

    def write(self, number: int, token: int) -> bool:
        """A client claims channel `number`, or gives it back with 0; whether it has a new owner. Raises `SdoRefused`.

        A client has one channel at most: a claim gives back the one that it had.
        """
        if number not in CLIENT_CHANNELS:
            raise SdoRefused(AbortCode.READ_ONLY)
        channel = self._channels[number]
        if token == NOBODY:
            if self.current != number:
                raise SdoRefused(AbortCode.DEVICE_STATE)
            self._channels[number] = _Channel()
            return False
        if self.current != CLAIM_CHANNEL:
            raise SdoRefused(AbortCode.DEVICE_STATE)
        is_renewed = channel.token == token and channel.origin == self._origin
        if not is_renewed and self.now_ns - channel.heard_ns < CLAIM_NS:
            raise SdoRefused(AbortCode.DEVICE_STATE)
        for other in CLIENT_CHANNELS:
            held = self._channels[other]
            if other != number and held.token == token and held.origin == self._origin:
                self._channels[other] = _Channel()
        self._channels[number] = _Channel(token, self._origin, self.now_ns)
        return not is_renewed

    def leave(self, origin: object) -> None:
        """A client has left the bus: what it had claimed is free."""
        for number in CLIENT_CHANNELS:
            if self._channels[number].token != NOBODY and self._channels[number].origin == origin:
                self._channels[number] = _Channel()
