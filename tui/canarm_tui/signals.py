"""What traces can show of a joint: each signal with its lines, unit, range and limits. Data, and no drawing."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from canarm_protocol.cell.model import Joint

from .history import Column

LIMIT_LSB = 1.0
"""An error within one step of the position sensor is below its resolution."""
NONE = ()


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a trace."""

    column: int
    label: str


@dataclass(frozen=True, slots=True)
class Signal:
    """A quantity: its lines, the first of which is the one that is compared; values times `factor` are in `unit`."""

    name: str
    unit: str
    lines: tuple[Line, ...]
    decimals: int
    is_about_zero: bool = True
    """Whether the scale reaches as far down as up."""
    factor: float = 1.0
    limits: Callable[[Joint], tuple[float, ...]] = lambda joint: NONE


def _of_current(joint: Joint) -> tuple[float, ...]:
    return joint.drive.max_current_a, -joint.drive.max_current_a


def _of_speed(joint: Joint) -> tuple[float, ...]:
    return joint.allowed_rad_s, -joint.allowed_rad_s


ERROR = Signal(
    "error", "LSB", (Line(Column.ERROR, "true − reference"),), 2, limits=lambda joint: (LIMIT_LSB, -LIMIT_LSB)
)
ANGLE = Signal(
    "angle",
    "°",
    (Line(Column.ANGLE, "true"), Line(Column.REFERENCE, "ref.")),
    2,
    is_about_zero=False,
    factor=float(np.degrees(1.0)),
)
CURRENT = Signal("current", "A", (Line(Column.CURRENT, "motor"), Line(Column.COMMAND, "cmd")), 3, limits=_of_current)
SPEED = Signal(
    "speed", "rad/s", (Line(Column.SPEED, "true"), Line(Column.MEASURED_SPEED, "meas.")), 3, limits=_of_speed
)


def signals_of(inner: tuple[str, ...], chosen: int) -> tuple[Signal, ...]:
    """All signals, in the order in which a key goes through them; of the law's `inner` values, the `chosen` one."""
    law = Signal(inner[chosen], "", (Line(Column.INTERNAL + chosen, "law"),), 3, is_about_zero=False)
    return ERROR, ANGLE, CURRENT, SPEED, law
