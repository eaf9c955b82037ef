"""Hands that open and close as bits of a latch tell them, and the stand on which an object waits for both.

Owns their clocks: how far each hand is open, and how much of the weight the stand still bears. What a hand holds, and
forces, belong to the grips.
"""

import math
from typing import Self

from canarm_protocol.cards.sc300 import HandBits
from canarm_protocol.cell.model import Carried

MASTER, SLAVE = "master", "slave"
TOUCH = 0.2
"""Opening at which the pads touch: in the rest of the way their rubber is pressed, and holds ever stiffer. Assumed."""


class Hand:
    """One hand: `opening` is 1 where it is wide open, `TOUCH` where its pads touch the object and 0 where it is closed.

    Its screw keeps it without current.
    """

    __slots__ = ("_closing_s", "bits", "opening")

    def __init__(self, opening: float, closing_s: float) -> None:
        self.opening, self._closing_s = opening, closing_s
        self.bits = int(HandBits.KEEP)

    @property
    def is_open(self) -> bool:
        """Whether it does not touch the object."""
        return self.opening > TOUCH

    @property
    def moves(self) -> bool:
        """Whether its motor turns."""
        return self.opening > 0.0 if self.bits == HandBits.CLOSE else self.bits == HandBits.OPEN and self.opening < 1.0

    def move(self, step_s: float) -> bool:
        """Let time pass. Whether it has begun or ceased to touch the object."""
        was_open = self.is_open
        if self.moves:
            way = step_s / self._closing_s * (1.0 if self.bits == HandBits.OPEN else -1.0)
            self.opening = min(max(self.opening + way, 0.0), 1.0)
        return was_open is not self.is_open


class Hands:
    """Both hands of a cell, and the stand: it bears the share `borne` of the weight, all of it until both hold."""

    __slots__ = ("_taken_up_s", "borne", "each")

    def __init__(self, carried: Carried) -> None:
        opening = 1.0 if carried.on_stand else 0.0
        self.each = {name: Hand(opening, carried.closing_s) for name in (MASTER, SLAVE)}
        self._taken_up_s = carried.taken_up_s
        self.borne = opening

    @property
    def firmness(self) -> float:
        """How far the pads are pressed, of the hand that is less closed: from 0 to 1."""
        return 1.0 - min(max(hand.opening for hand in self.each.values()), TOUCH) / TOUCH

    @property
    def moves(self) -> bool:
        """Whether anything is on its way."""
        return 0.0 < self.borne < 1.0 or any(hand.moves for hand in self.each.values())

    def move(self, step_s: float) -> tuple[str, ...]:
        """Let time pass. Returns the hands that have begun or ceased to touch the object."""
        if 0.0 < self.borne < 1.0:
            self.borne = max(self.borne - step_s / self._taken_up_s, 0.0)
        return tuple(name for name, hand in self.each.items() if hand.move(step_s))

    def take_up(self) -> None:
        """The stand begins to sink."""
        self.borne = math.nextafter(1.0, 0.0)

    def take_over(self, before: Self) -> None:
        """Be where another pair is."""
        self.each, self.borne = before.each, before.borne
