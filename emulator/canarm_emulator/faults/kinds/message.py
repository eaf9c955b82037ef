"""Faults on messages, in one direction of the robot's bus.

`cob_id` picks one identifier; 0 means every frame, so that NMT, whose identifier is 0, cannot be picked alone.
"""

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field
from random import Random

from canarm_protocol.canopen.frames import Frame

from ..declaration import Context, Family, MessageFault, TapKind
from ..parameters import parameter

_MESSAGES = (TapKind.MESSAGES,)
MILLISECOND = 1_000_000
SECOND = 1_000_000_000

Stamped = tuple[int, Frame]


@dataclass
class _Picking(MessageFault):
    """A fault on the frames of one identifier, or on all."""

    cob_id: int = parameter(
        "which identifier; 0: every frame (NMT, 0x000, cannot be picked alone)", "", 0, 0, 0x7FF, is_whole=True
    )
    probability: float = parameter("that it hits a frame", "", 1.0, 0.0, 1.0)
    _random: Random = field(default_factory=Random)

    def begin(self, context: Context) -> None:
        """Take the randomness of this activation."""
        self._random = context.random

    def pass_on(self, frame: Frame, now_ns: int) -> Iterable[Stamped]:
        """Frames of other identifiers pass."""
        is_meant = not self.cob_id or (frame.can_id == self.cob_id and not frame.is_extended)
        if not is_meant or (self.probability < 1.0 and self._random.random() >= self.probability):
            return ((now_ns, frame),)
        return self.hit(frame, now_ns)

    @abstractmethod
    def hit(self, frame: Frame, now_ns: int) -> Iterable[Stamped]:
        """What becomes of a frame that is hit."""


@dataclass
class Lost(_Picking, name="lost", family=Family.MESSAGE, acts_on=_MESSAGES):
    """Frames do not arrive, and nobody is told."""

    def hit(self, frame: Frame, now_ns: int) -> Iterable[Stamped]:
        """Nothing."""
        return ()


@dataclass
class Delayed(_Picking, name="delayed", family=Family.MESSAGE, acts_on=_MESSAGES):
    """Frames arrive late."""

    delay: float = parameter("by how much", "ms", 5.0, 0.0, 1000.0)

    def hit(self, frame: Frame, now_ns: int) -> Iterable[Stamped]:
        """The frame, later."""
        return ((now_ns + round(self.delay * MILLISECOND), frame),)


@dataclass
class Repeated(_Picking, name="repeated", family=Family.MESSAGE, acts_on=_MESSAGES):
    """Frames arrive more than once."""

    copies: int = parameter("how many more", "", 1, 1, 20, is_whole=True)

    def hit(self, frame: Frame, now_ns: int) -> Iterable[Stamped]:
        """The frame, and its copies."""
        return ((now_ns, frame),) * (1 + self.copies)


@dataclass
class Reordered(_Picking, name="reordered", family=Family.MESSAGE, acts_on=_MESSAGES):
    """Frames change places in pairs: each second one comes before the one that was sent first."""

    _held: Frame | None = None

    def hit(self, frame: Frame, now_ns: int) -> Iterable[Stamped]:
        """Nothing for the first of a pair, both for the second."""
        held, self._held = self._held, None
        if held is None:
            self._held = frame
            return ()
        return (now_ns, frame), (now_ns, held)

    def rest(self, now_ns: int) -> Iterable[Stamped]:
        """The first of a pair whose second did not come."""
        held, self._held = self._held, None
        return () if held is None else ((now_ns, held),)


@dataclass
class Corrupted(_Picking, name="corrupted", family=Family.MESSAGE, acts_on=_MESSAGES, is_dangerous=True):
    """Bits of the data are inverted behind the CRC's back, as in a node's memory."""

    byte: int = parameter("which byte of the data, from 0", "", 1, 0, 7, is_whole=True)
    mask: int = parameter("which bits of it", "", 0x20, 1, 255, is_whole=True)

    def hit(self, frame: Frame, now_ns: int) -> Iterable[Stamped]:
        """The frame with other data; a shorter one passes."""
        if self.byte >= len(frame.data):
            return ((now_ns, frame),)
        data = bytearray(frame.data)
        data[self.byte] ^= self.mask
        return ((now_ns, frame._replace(data=bytes(data))),)


@dataclass
class Masqueraded(_Picking, name="masqueraded", family=Family.MESSAGE, acts_on=_MESSAGES, is_dangerous=True):
    """Another node uses the identifier: each frame is followed by a forged one of the same length."""

    fill: int = parameter("each byte of the forged frame", "", 0x20, 0, 255, is_whole=True)

    def hit(self, frame: Frame, now_ns: int) -> Iterable[Stamped]:
        """The frame and the forged one."""
        return (now_ns, frame), (now_ns, frame._replace(data=bytes([self.fill]) * len(frame.data)))


@dataclass
class TooEarly(_Picking, name="too-early", family=Family.MESSAGE, acts_on=_MESSAGES):
    """Frames leave before their data are there: each carries the data of the one before it."""

    _last: dict[int, bytes] = field(default_factory=dict)

    def hit(self, frame: Frame, now_ns: int) -> Iterable[Stamped]:
        """The frame with old data; the first passes."""
        data = self._last.get(frame.can_id, frame.data)
        self._last[frame.can_id] = frame.data
        return ((now_ns, frame._replace(data=data)),)


@dataclass
class BabblingIdiot(MessageFault, name="babbling-idiot", family=Family.MESSAGE, acts_on=_MESSAGES, needs_wire=True):
    """A node sends without end, and wins arbitration against all that it outranks."""

    cob_id: int = parameter("the identifier that it uses", "", 1, 1, 0x7FF, is_whole=True)
    rate: float = parameter("frames a second", "1/s", 15_000.0, 1.0, 100_000.0)
    length: int = parameter("bytes a frame", "byte", 0, 0, 8, is_whole=True)
    _next_ns: int = 0

    def begin(self, context: Context) -> None:
        """The first frame comes at once."""
        self._next_ns = context.now_ns

    def pass_on(self, frame: Frame, now_ns: int) -> Iterable[Stamped]:
        """Others' frames pass; the wire makes them wait."""
        return ((now_ns, frame),)

    def due(self, until_ns: int) -> Iterable[Stamped]:
        """Its frames of the coming cycle."""
        interval_ns = round(SECOND / self.rate)
        frame = Frame(self.cob_id, bytes(self.length))
        times = range(self._next_ns, until_ns, interval_ns)
        self._next_ns += len(times) * interval_ns
        return [(time_ns, frame) for time_ns in times]
