"""The request for a new cell: an arm, and how its cell is to be timed and wired."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..usage import UsageError

DEFAULT_CYCLE_US = 2500
DEFAULT_BITRATE = 1_000_000
DEFAULT_BITS = 8
DEFAULT_SENSING = ("potentiometer", "tachometer", "current_sense")
POSITION_KINDS = ("potentiometer", "encoder")
Sensing = tuple[str, ...]
"""Kinds of sensor, in the order in which a card samples them."""


class NewCellError(UsageError):
    """No cell can be made as requested: what does not fit, the arithmetic, and what would fit."""


@dataclass(frozen=True, slots=True)
class ArmJoint:
    """One joint without a drive. `body` is a cell's table; None if a URDF file describes it.

    `speed_rad_s` is its highest speed, `effort_nm` the most torque; they and the friction are None where not stated.
    """

    name: str
    limits_deg: tuple[float, float]
    home_deg: float
    body: Mapping[str, Any] | None
    comment: str = ""
    states_limits: bool = True
    speed_rad_s: float | None = None
    effort_nm: float | None = None
    viscous_nm_s: float | None = None
    coulomb_nm: float | None = None


@dataclass(frozen=True, slots=True)
class Arm:
    """An arm without drives; `urdf` is the path of its file as the cell names it."""

    name: str
    title: str
    joints: Sequence[ArmJoint]
    urdf: str | None = None


@dataclass(frozen=True, slots=True)
class Request:
    """What the cell is to be like: a `cycle_us` of None is 2500 us, or the next that fits."""

    cycle_us: int | None = None
    bitrate: int = DEFAULT_BITRATE
    bits: int = DEFAULT_BITS
    sensing: Sensing = DEFAULT_SENSING
