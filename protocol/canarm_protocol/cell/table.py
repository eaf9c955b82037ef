"""What every table of a cell is made of: strict, frozen, and the types of its numbers and names.

No table itself enters.
"""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

DEGREE = 0.017453292519943295
"""One degree in rad."""

LARGEST = 1e9
"""In its unit, no quantity of a cell is larger: beyond, squares and products of them would leave what floats hold."""

Positive = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]*$", max_length=32)]
Vector = tuple[Finite, Finite, Finite]


class Table(BaseModel):
    """One table of the TOML file: strict types, unknown keys refused, frozen."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
