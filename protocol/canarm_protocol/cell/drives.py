"""The kinds of drive of a joint, which turn a card's outputs into motor current: nominal values.

The emulator models their circuits.
"""

from enum import StrEnum
from typing import ClassVar, Literal

from ..cards.kind import highest_code
from .sensors.base import SensorScale
from .table import Positive, Table


class Command(StrEnum):
    """What a drive takes from a card: the second half of a signal, `<joint>.<command>`."""

    CURRENT = "current_command"
    DIRECTION = "direction"
    GRIP = "grip"
    """Of the hand at a robot's last joint, no drive of its own: see `HandBits`."""


class D669(Table):
    """Op-amp and D669 current amplifier with its bridge: a magnitude from a DAC, and two bits of direction."""

    commands: ClassVar[tuple[Command, ...]] = (Command.CURRENT, Command.DIRECTION)

    kind: Literal["d669"]
    max_current_a: Positive
    supply_v: Positive
    opamp_full_scale_v: Positive

    def current_scale(self, bits: int) -> SensorScale:
        """Nominal scale of the DAC's codes: magnitude of the motor current in A per code."""
        return SensorScale(0.0, self.max_current_a / highest_code(bits))


Drive = D669
"""Any kind of drive; will be a union over `kind` when there are two."""
