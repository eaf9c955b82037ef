"""What the tables of a cell have in common: a strict, frozen base, and the types of numbers and names."""

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

DEGREE = 0.017453292519943295
"""One degree in rad."""

LARGEST = 1e9
"""Largest number in a cell, in its own unit: squares and products of it stay within the range of floats."""

SMALLEST = 1e-12
"""In its unit, no quantity that must be there is smaller, likewise."""


def at_least(least: float) -> AfterValidator:
    """A quantity that may not be smaller, for what the arithmetic or the physics engine need."""

    def check(value: float) -> float:
        if value < least:
            raise PydanticCustomError("too_small", "too small", {"least": least})
        return value

    return AfterValidator(check)


def away_from_zero(value: float) -> float:
    """A quantity of either sign that must be there. Raises `PydanticCustomError` for one that is too small."""
    if abs(value) < SMALLEST:
        raise PydanticCustomError("zero", "zero", {"least": SMALLEST})
    return value


Positive = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False), at_least(SMALLEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
NonZero = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False), AfterValidator(away_from_zero)]
"""Negative for a part that works the other way round."""
Sign = Literal[1, -1]
"""Which way round a part is mounted, or a joint counts."""
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]*$", max_length=32)]
Vector = tuple[Finite, Finite, Finite]


class Table(BaseModel):
    """One table of the TOML file: strict types, unknown keys refused, frozen."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
