"""What comes out of the wire: frames that arrived, transmissions that failed, nodes that changed their error state."""

from collections.abc import Hashable
from typing import NamedTuple

from canarm_protocol.canopen.frames import Frame

from .confinement import ErrorKind, ErrorState


class Delivery(NamedTuple):
    """A frame that every node on the bus has at `end_ns`, its last bit, but its sender and those in `missed_by`."""

    end_ns: int
    frame: Frame
    sender: Hashable
    start_ns: int
    missed_by: frozenset[Hashable] = frozenset()


class ErrorFrame(NamedTuple):
    """A transmission that ended in an error; `end_ns` is the end of the error delimiter. The frame is sent again."""

    end_ns: int
    kind: ErrorKind
    frame: Frame
    sender: Hashable


class StateChange(NamedTuple):
    """A node's error state from `time_ns` on."""

    time_ns: int
    node: Hashable
    state: ErrorState
