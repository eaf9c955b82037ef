"""The request for a new cell: an arm, and how its cell is to be timed and wired."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from canarm_protocol.cards.analogue import FEWEST_BITS, MOST_BITS
from canarm_protocol.cell.model import BITRATES

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
    """What the cell is to be like: a `cycle_us` of None is 2500 us, or the next that fits.

    Raises `NewCellError` for a resolution or bit rate that no cell can have.
    """

    cycle_us: int | None = None
    bitrate: int = DEFAULT_BITRATE
    bits: int = DEFAULT_BITS
    sensing: Sensing = DEFAULT_SENSING

    def __post_init__(self) -> None:
        if not FEWEST_BITS <= self.bits <= MOST_BITS:
            raise NewCellError(f"--bits {self.bits}: must be {FEWEST_BITS} to {MOST_BITS}")
        if self.bitrate not in BITRATES:
            raise NewCellError(f"--bitrate {self.bitrate}: must be one of {', '.join(map(str, BITRATES))}")
