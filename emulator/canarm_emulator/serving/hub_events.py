"""What `Hub.poll` reports, in the order in which it came."""

from typing import NamedTuple, Protocol

from canarm_protocol.canopen.frames import Frame


class HasFileno(Protocol):
    """What `select` can watch."""

    def fileno(self) -> int:
        """File descriptor."""
        ...


class Received(NamedTuple):
    """A frame came on a bus, from a client by its number or from a port."""

    channel: str
    origin: object
    frame: Frame


class Attached(NamedTuple):
    """A client opened a channel."""

    channel: str
    client_id: int


class Detached(NamedTuple):
    """A client that had opened a channel is gone."""

    channel: str
    client_id: int


class Ready(NamedTuple):
    """A watched file object is readable, or broken, in which case it is no longer watched."""

    fileobj: HasFileno


class Unreadable(NamedTuple):
    """A client has sent unreadable input for the first time; this and all further such input is dropped."""

    channel: str | None
    client_id: int
    text: str


Event = Received | Attached | Detached | Ready | Unreadable
