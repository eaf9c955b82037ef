"""The index of each joint's encoder: where its pulses come, what they make of the counts, and whether homing can work.

How a joint gets to a pulse belongs to the controller.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from .model import Card, Cell
from .sensing import WiredSensor, joint_sensors
from .sensors import SensorScale
from .sensors.encoder import Encoder


@dataclass(frozen=True, slots=True)
class IndexMark:
    """The index of one joint's encoder, whose pulses come at multiples of `counts` from the joint's angle 0."""

    joint: int
    card: Card
    channel: int
    counts: int
    """From one pulse to the next."""
    scale: SensorScale
    """As if the joint were parked exactly at home."""
    home_rad: float

    @property
    def period_rad(self) -> float:
        """Angle of the joint from one pulse to the next."""
        return self.counts * self.scale.lsb

    @property
    def unique_within_rad(self) -> float:
        """A joint that is parked nearer than this to home is known by a pulse: half a turn, less half a count."""
        return 0.5 * (self.counts - 1) * self.scale.lsb

    def zero(self, count: int) -> float:
        """The zero of the scale by `count`, latched at a pulse, if the joint was parked within `unique_within_rad`.

        It counted from anywhere between two edges; the pulse is the one that puts the middle of them nearest to home.
        """
        expected = count + self.home_rad / self.scale.step - 0.5
        return count - 0.5 - round(expected / self.counts) * self.counts


def index_marks(cell: Cell) -> tuple[IndexMark, ...]:
    """The indices of all joints with an encoder, in the order of the joints."""
    return tuple(mark for sensors in joint_sensors(cell) for mark in _marks(cell, sensors.position))


def homing_problems(cell: Cell) -> Iterator[str]:
    """Why the joints of a cell cannot be homed by their indices as `[control.homing]` says."""
    homing = cell.control.homing
    if homing is None:
        return
    marks = index_marks(cell)
    if not marks:
        yield "control.homing: no joint has an encoder, and so no index to home by; leave it out"
    for mark in marks:
        bound_deg = math.degrees(mark.unique_within_rad)
        if homing.parked_within_deg >= bound_deg:
            yield (
                f"control.homing.parked_within_deg = {homing.parked_within_deg:g}: the index of joint "
                f"{cell.joint_names[mark.joint]!r} comes every {mark.counts} counts, "
                f"{math.degrees(mark.period_rad):.4g} degrees; must be below half of that less half a count, "
                f"{bound_deg:.4g}, or nobody knows which pulse it was"
            )


def _marks(cell: Cell, wired: WiredSensor) -> Iterator[IndexMark]:
    if isinstance(wired.sensor, Encoder):
        counts = wired.sensor.counts_per_index(getattr(wired.card, "decoding", 1))
        home_rad = math.radians(cell.joints[wired.joint].home_deg)
        yield IndexMark(wired.joint, wired.card, wired.channel, counts, wired.scale, home_rad)
