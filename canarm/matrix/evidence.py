"""What is known of one run: the true motion, what the controller received, and what it noticed.

It is the same for a rig and for processes on a bus. Nothing is judged here.
"""

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.model import Cell, Quantity
from canarm_protocol.cell.sensing import joint_sensors
from canarm_protocol.cell.wiring import InputSlot, card_nodes, input_slots

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SENSORS = (Quantity.POSITION, Quantity.VELOCITY, Quantity.CURRENT)
_HALF_NS = 0.5e-9


@dataclass(frozen=True, eq=False)
class Motion:
    """The truth, one row per SYNC: cycles and times (n,), the rest (n, joints). NaN where there is no reference.

    Rows after the last SYNC have its cycle number, but their own times.
    """

    cycle: Ints
    time_s: Floats
    angle_rad: Floats
    speed_rad_s: Floats
    current_a: Floats
    command_a: Floats
    motor_speed_rad_s: Floats
    reference_rad: Floats


def motion_of(cycle: Ints, time_s: Floats, joints: Floats, reference_rad: Floats) -> Motion:
    """`joints` has the values of `canarm_emulator.robot.world.JointState` in their order, shape (n, joints, 6)."""
    angle_rad, speed_rad_s, current_a, command_a, _, motor_speed_rad_s = np.moveaxis(joints, 2, 0)
    return Motion(cycle, time_s, angle_rad, speed_rad_s, current_a, command_a, motor_speed_rad_s, reference_rad)


class Notice(NamedTuple):
    """Something that the controller noticed or did: by which detector, where, in which cycle.

    `stops` says whether the run ends by it.
    """

    detector: str
    where: str
    cycle: int
    reaction: str
    stops: bool


@dataclass(frozen=True, eq=False)
class Evidence:
    """One run. For each sensor, `seen` is what the controller last received by the end of each cycle, in its unit,
    shape (n, joints); NaN before the first. `injected_cycle` is the first in which the fault acted.
    """

    motion: Motion
    seen: dict[Quantity, Floats]
    notices: tuple[Notice, ...]
    injected_cycle: int
    is_running: bool
    """Whether the controller was still running at the end."""
    grip_n: float | None = None
    """The greatest force of a hand on the object that two robots carry, since the injection; None without an object."""
    lost_by: tuple[str, ...] = ()
    """Hands that hold it no longer at the end: "master", "slave"."""


class Received(NamedTuple):
    """A frame that the controller received, and when."""

    time_s: float
    frame: Frame


def seen_by_controller(cell: Cell, frames: Iterable[Received], time_s: Floats) -> dict[Quantity, Floats]:
    """What had arrived of `frames` (in order of time) before the SYNC that follows each of `time_s`; see `Evidence`.

    Frames without usable process data are ignored, as the controller ignores them.
    """
    layouts, slots = inputs_of(cell)
    lowest = {slot.cob_id: slot.codec.lowest_value for slot in slots}
    times: dict[int, list[float]] = {cob_id: [] for cob_id in layouts}
    values: dict[int, list[tuple[int, ...]]] = {cob_id: [] for cob_id in layouts}
    for stamp_s, (can_id, data, is_extended, is_remote) in frames:
        layout = layouts.get(can_id)
        if layout is None or is_extended or is_remote or len(data) < layout.size:
            continue
        unpacked = layout.unpack(data[: layout.size])
        if min(unpacked) >= lowest[can_id]:
            times[can_id].append(stamp_s)
            values[can_id].append(unpacked)
    ends_s = np.append(time_s[1:], np.inf) - _HALF_NS
    seen = {sensor: np.full((len(time_s), len(cell.joints)), np.nan) for sensor in SENSORS}
    for slot in slots:
        codes = [slot.codec.code(each[slot.position]) for each in values[slot.cob_id]]
        seen[slot.quantity][:, slot.joint] = _held(np.array(times[slot.cob_id]), _scaled(cell, slot, codes), ends_s)
    return seen


@functools.lru_cache(maxsize=4)
def inputs_of(cell: Cell) -> tuple[dict[int, PdoLayout], tuple[InputSlot, ...]]:
    """Layouts of the TPDOs by COB-ID, and what in them is whose. Reads a dictionary a card: ask before you fork."""
    nodes = card_nodes(cell)
    return {layout.cob_id: layout for node in nodes for layout in node.tpdos}, input_slots(cell, nodes)


def _scaled(cell: Cell, slot: InputSlot, codes: list[int]) -> Floats:
    wired = joint_sensors(cell)[slot.joint].measuring(slot.quantity)
    assert wired is not None, "a slot is made of a wired sensor"
    scale = wired.scale
    return (np.array(codes, dtype=np.float64) - scale.zero) * scale.step


def _held(times_s: Floats, values: Floats, ends_s: Floats) -> Floats:
    """The last of `values` before each end; NaN where there is none."""
    return np.append(np.nan, values)[np.searchsorted(times_s, ends_s, side="left")]
