"""What the dashboard asks of whoever drives the cards by hand: the commands of `canarm jog`, as texts.

The driver itself is handed in; the dashboard has no master of its own.
"""

from collections.abc import Sequence
from enum import Enum
from typing import Protocol


class HandState(Enum):
    """What the hand is doing."""

    OFF = "off"
    BUSY = "working"
    READY = "ready"


class Hand(Protocol):
    """Drives the cards where no controller runs. No method waits."""

    @property
    def state(self) -> HandState:
        """Whether the cards are in hand."""

    @property
    def lines(self) -> Sequence[tuple[bool, str]]:
        """What it has said last, oldest first: whether something is wrong, and a line of text."""

    @property
    def codes(self) -> Sequence[int]:
        """The code of each joint's output, as commanded last, even if it still waits; empty while the cards are not in
        hand.
        """

    @property
    def directions(self) -> Sequence[str]:
        """The direction of each joint's output, as commanded last: off, ccw or cw; empty as `codes` is."""

    @property
    def help(self) -> str:
        """The commands that it knows, in lines."""

    def take(self) -> None:
        """Find, check, configure and start the cards; where another controller is, only say so."""

    def do(self, commands: str) -> None:
        """Carry out commands, one after the other: "dac joint2 68; step 10"."""

    def release(self) -> None:
        """Outputs off, cards in PRE-OPERATIONAL."""

    def close(self) -> None:
        """As `release`, at the latest after a second or two."""
