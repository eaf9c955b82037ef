"""The kinds of drive that a joint can have: what turns a card's outputs into motor current, nominally.

Their electrics belong to the emulator.
"""

from enum import StrEnum
from typing import ClassVar, Literal

from .sensors.base import SensorScale, highest_code
from .table import Positive, Table


class Command(StrEnum):
    """What a drive takes from a card: the second half of a signal, `<joint>.<command>`."""

    CURRENT = "current_command"
    DIRECTION = "direction"


class D669(Table):
    """Op-amp and D669 current amplifier with its bridge: a magnitude from a DAC, and two bits of direction."""

    commands: ClassVar[tuple[Command, ...]] = (Command.CURRENT, Command.DIRECTION)

    kind: Literal["d669"]
    max_current_a: Positive
    supply_v: Positive
    opamp_full_scale_v: Positive

    def current_scale(self, bits: int) -> SensorScale:
        """Nominal scale of the DAC's codes: A of motor current a code, without sign."""
        return SensorScale(0.0, self.max_current_a / highest_code(bits))


Drive = D669
"""Any kind of drive: a union over `kind` as soon as there are two."""
