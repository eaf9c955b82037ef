"""The kinds of brake that a joint can have, nominally: `brake = "none"`, a kind's name, or a table with its `kind`.

A brake is on the motor's side of the drive wire. It is released while the joint's amplifier is asked for current, and
engages by itself when it is not: no controller commands it. What it does to the arm belongs to the emulator.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, SerializeAsAny, ValidatorFunctionWrapHandler, WrapValidator
from pydantic_core import PydanticCustomError

from .table import NonNegative, Positive, Table

NONE = "none"
"""What stands in a cell for a joint without a brake, beside leaving it out."""

Delay = Annotated[float, Field(ge=0, le=1000, allow_inf_nan=False)]


class Brake(Table):
    """What brakes of every kind have."""

    kind: str
    delay_ms: Delay
    """From the last moment in which current was asked for until it acts."""


class DynamicBrake(Brake):
    """The bridge shorts the winding through a resistor: the motor brakes as a generator, and holds nothing at rest."""

    kind: Literal["dynamic"]
    delay_ms: Delay = 10.0
    resistor_ohm: NonNegative = 0.0
    """In series with the winding: it bounds the current."""


class SpringBrake(Brake):
    """Springs press a disc on the motor's shaft as soon as its coil is dead: dry friction, at rest as in motion."""

    kind: Literal["spring"]
    delay_ms: Delay = 20.0
    release_ms: Delay = 20.0
    """From the first moment in which current is asked for until it is free."""
    torque_nm: Positive | None = None
    """At the joint; unless given, what the motor has at its amplifier's highest current."""


BRAKE_TYPES: Mapping[str, type[Brake]] = {"dynamic": DynamicBrake, "spring": SpringBrake}
"""By name. A new kind is one line here."""


def _of_its_kind(value: Any, handler: ValidatorFunctionWrapHandler) -> Brake | None:
    """The brake that a word or a table means; None for none."""
    table = {"kind": value} if isinstance(value, str) else value
    if table is None or (isinstance(table, Mapping) and table == {"kind": NONE}):
        return None
    if isinstance(table, Brake) or not isinstance(table, Mapping):
        brake: Brake | None = handler(table)
        return brake
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in BRAKE_TYPES:
        names = ", ".join(f'"{name}"' for name in (NONE, *BRAKE_TYPES))
        raise PydanticCustomError("enum", "no such brake", {"expected": f"one of {names}, or a table with its kind"})
    return BRAKE_TYPES[kind].model_validate(table)


FittedBrake = Annotated[SerializeAsAny[Brake] | None, WrapValidator(_of_its_kind)]
"""The brake of a joint, or None."""
