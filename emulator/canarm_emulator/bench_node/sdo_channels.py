"""Which client owns which SDO channel of the bench node: claims, their expiry, and who may use a channel.

A client writes a token, a number other than 0, to CHANNEL_OWNER:n over the claim channel and reads it back: it owns the
channel if it reads its own token. It gives the channel back by writing 0 over the channel itself. A channel that nobody
has claimed serves anybody.
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
    """Time of the last request, on the clock that the runner sets."""


class SdoChannels:
    """The channels of one bench node. `now_ns` is the clients' clock, set by whoever drives the bench."""

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
        """Whether a frame is to be served. False if it comes from a stranger on a claimed channel."""
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
        """Claim channel `number`, or give it back with 0. Returns whether it has a new owner. Raises `SdoRefused`.

        A client owns one channel at most: a claim gives back the one before.
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
        """A client has left the bus: free its channel."""
        for number in CLIENT_CHANNELS:
            if self._channels[number].token != NOBODY and self._channels[number].origin == origin:
                self._channels[number] = _Channel()
