"""Feed-forward: the torque that the nominal robot needs along the reference, from a table or computed in the cycle.

Owns the choice between no feed-forward, the paper's table in memory, and evaluation on line. Feedback must not enter.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from canarm_protocol.shown import quoted

from ..dynamics import Arm, Floats
from ..errors import ControllerError
from .memory import SAMPLES, MemoryImage
from .trajectory import Reference


class FeedforwardKind(StrEnum):
    """Where the feed-forward torque comes from."""

    NONE = "none"
    TABLE = "table"
    ONLINE = "online"


class Feedforward(ABC):
    """Feed-forward torques, one block of reference at a time."""

    clipped_samples: int = 0
    """Samples of the last block at which the amplifier cannot deliver the torque."""

    @abstractmethod
    def prepare(self, reference_block: Reference, first_tick: int) -> None:
        """Take the reference of the ticks from `first_tick` on, at most 4096, before `torque_nm` is asked for them."""

    @abstractmethod
    def torque_nm(self, tick: int) -> Sequence[float]:
        """Joint torques in N·m for the command computed in cycle `tick`."""


class NoFeedforward(Feedforward):
    """Zero torque: feedback does all the work."""

    def __init__(self, joint_count: int) -> None:
        self._zero = (0.0,) * joint_count

    def prepare(self, reference_block: Reference, first_tick: int) -> None:
        """Nothing to prepare."""

    def torque_nm(self, tick: int) -> Sequence[float]:
        """Zeros."""
        return self._zero


class TableFeedforward(Feedforward):
    """The paper's method: torques for 10.24 s, stored as 8-bit currents, and played back one sample per cycle."""

    def __init__(self, arm: Arm, image: MemoryImage, exclude_inertia: bool, lead_s: float) -> None:
        self._arm = arm
        self._image = image
        self._exclude_inertia = exclude_inertia
        self._lead_s = lead_s
        self._pages = [
            ([per_ampere * current for current in image.currents_by_byte(joint)], image.table_bytes(joint))
            for joint, per_ampere in enumerate(arm.torque_per_ampere)
        ]
        """For each joint the torque of each of the 256 table bytes, and its page."""

    def prepare(self, reference_block: Reference, first_tick: int) -> None:
        """Compute the block and load the table. Raises `ControllerError` unless it starts on a table boundary."""
        if first_tick % SAMPLES:
            raise ControllerError(f"torque table: block begins at tick {first_tick}; must be a multiple of {SAMPLES}")
        position, velocity, acceleration = _advanced(reference_block, self._lead_s)
        torque = self._arm.torque_batch_nm(position, velocity, acceleration)
        if self._exclude_inertia:
            torque -= self._arm.effective_inertia * acceleration
        current = torque / self._arm.torque_per_ampere
        self.clipped_samples = sum(
            self._image.load_table(joint, current[:, joint]) for joint in range(current.shape[1])
        )

    def torque_nm(self, tick: int) -> Sequence[float]:
        """What the table holds for the cycle, quantised to two steps of an 8-bit DAC."""
        sample = tick % SAMPLES
        return [torques[page[sample]] for torques, page in self._pages]


class OnlineFeedforward(Feedforward):
    """The same torque, evaluated in the cycle in which it is needed, without quantisation."""

    def __init__(self, arm: Arm, exclude_inertia: bool, lead_s: float) -> None:
        self._arm = arm
        self._taken_out = arm.effective_inertia if exclude_inertia else None
        self._lead_s = lead_s
        self._first_tick = 0
        self._block: tuple[Floats, Floats, Floats] = (np.empty((0, arm.joint_count)),) * 3

    def prepare(self, reference_block: Reference, first_tick: int) -> None:
        """Keep the block. Turning it into plain floats at once would take more than a cycle has."""
        self._first_tick = first_tick
        self._block = _advanced(reference_block, self._lead_s)

    def torque_nm(self, tick: int) -> Sequence[float]:
        """Inverse dynamics at the cycle's reference. Raises `ControllerError` outside the prepared block."""
        index = tick - self._first_tick
        count = len(self._block[0])
        if not 0 <= index < count:
            last = self._first_tick + count - 1
            raise ControllerError(f"feed-forward: tick {tick} is not prepared; ticks {self._first_tick} to {last} are")
        position, velocity, acceleration = (part[index].tolist() for part in self._block)
        torque_nm = self._arm.torque_nm(position, velocity, acceleration)
        if self._taken_out is None:
            return torque_nm
        return [
            torque - inertia * change
            for torque, inertia, change in zip(torque_nm, self._taken_out, acceleration, strict=True)
        ]


def make_feedforward(
    kind: str, arm: Arm, image: MemoryImage | None, exclude_inertia: bool, lead_s: float = 0.0
) -> Feedforward:
    """The feed-forward that the command line names: "none", "table" or "online".

    `exclude_inertia` takes J_i·q̈_d (J_i = `arm.effective_inertia`) out again, for laws whose feedback supplies it.
    `lead_s` looks ahead: a command computed in cycle k acts from SYNC k+1 to k+2, on average 1.5 cycles later.

    Raises `ControllerError` for another word, or for "table" without a memory image.
    """
    match kind:
        case FeedforwardKind.NONE:
            return NoFeedforward(arm.joint_count)
        case FeedforwardKind.ONLINE:
            return OnlineFeedforward(arm, exclude_inertia, lead_s)
        case FeedforwardKind.TABLE if image is not None:
            return TableFeedforward(arm, image, exclude_inertia, lead_s)
        case FeedforwardKind.TABLE:
            raise ControllerError("feed-forward 'table' needs a memory image to keep the table in; 'online' needs none")
    raise ControllerError(f"feed-forward {quoted(kind)}: no such kind; must be one of {', '.join(FeedforwardKind)}")


def _advanced(reference: Reference, lead_s: float) -> tuple[Floats, Floats, Floats]:
    """The reference `lead_s` later, extrapolated at constant acceleration: exact to the jerk over a few ms."""
    position, velocity, acceleration = reference.position_rad, reference.velocity_rad_s, reference.acceleration_rad_s2
    return (
        position + lead_s * velocity + 0.5 * lead_s**2 * acceleration,
        velocity + lead_s * acceleration,
        acceleration,
    )
