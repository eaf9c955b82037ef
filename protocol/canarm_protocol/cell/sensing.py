"""What the cell measures: each joint's sensors with card, channel, scale and sampling time.

Scales and steps come from here; `wiring.py` knows how frames carry the codes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from .model import Card, Cell, Channel
from .sensors import SENSOR_KINDS, Fitting, Quantity, Sensor, SensorScale
from .table import DEGREE


@dataclass(frozen=True, slots=True)
class WiredSensor:
    """A sensor of a joint (index in `cell.joints`) at a channel of a card.

    `skew_s` is the time from SYNC to its sample, `signal` its name in the whole cell, such as "joint2.potentiometer".
    """

    joint: int
    signal: str
    sensor: Sensor
    card: Card
    channel: int
    bits: int
    scale: SensorScale
    skew_s: float
    gear_ratio: float
    """Turns of the motor per turn of the joint."""

    @property
    def quantity(self) -> Quantity:
        """What it measures."""
        return self.sensor.quantity

    @property
    def highest_code(self) -> int:
        """The full-scale code of its card."""
        return self.card.codec.full_scale


@dataclass(frozen=True, slots=True)
class JointSensors:
    """The sensors of one joint; every joint has a position sensor."""

    position: WiredSensor
    velocity: WiredSensor | None
    current: WiredSensor | None

    def measuring(self, quantity: Quantity) -> WiredSensor | None:
        """The one that measures `quantity`; None without one."""
        return {Quantity.POSITION: self.position, Quantity.VELOCITY: self.velocity}.get(quantity, self.current)


def wired_sensors(cell: Cell) -> tuple[WiredSensor, ...]:
    """Every sensor of the cell, card by card in the order of channels."""
    return tuple(_wired(cell, card, channel, rank) for card in cell.card for rank, channel in enumerate(_inputs(card)))


def joint_sensors(cell: Cell) -> tuple[JointSensors, ...]:
    """The sensors of each joint, in the order of `cell.joints`."""
    found = {(wired.joint, wired.quantity): wired for wired in wired_sensors(cell)}
    return tuple(
        JointSensors(
            found[joint, Quantity.POSITION],
            found.get((joint, Quantity.VELOCITY)),
            found.get((joint, Quantity.CURRENT)),
        )
        for joint in range(len(cell.joints))
    )


def position_steps_rad(cell: Cell) -> list[float]:
    """The step of each joint's position sensor, rad: the unit in which tracking is judged."""
    return [sensors.position.scale.lsb for sensors in joint_sensors(cell)]


def fitted_sensor(cell: Cell, card: Card, channel: Channel) -> Sensor | None:
    """The sensor at the far end of a channel; None for an output, and for a sensor that the joint does not have."""
    sensor = getattr(cell.joints[cell.far_joint(card, channel)].sensors, channel.leaf, None)
    return sensor if channel.leaf in SENSOR_KINDS and isinstance(sensor, Sensor) else None


def channel_scale(cell: Cell, card: Card, channel: Channel) -> SensorScale:
    """Nominal scale of the codes of an input channel. Raises `LookupError` for a channel without a sensor."""
    sensor, joint = fitted_sensor(cell, card, channel), cell.joints[cell.far_joint(card, channel)]
    if sensor is None:
        raise LookupError(f"{channel.signal}: no sensor of the joint")
    edges = getattr(card, "decoding", 1)
    return sensor.scale(Fitting(card.codec.bits, edges, joint.motor.gear_ratio, joint.home_deg * DEGREE))


def _inputs(card: Card) -> Sequence[Channel]:
    return sorted(
        (channel for channel in card.channel if channel.leaf in SENSOR_KINDS), key=lambda channel: channel.number
    )


def _wired(cell: Cell, card: Card, channel: Channel, rank: int) -> WiredSensor:
    joint, sensor = cell.far_joint(card, channel), fitted_sensor(cell, card, channel)
    assert sensor is not None, f"{channel.signal}: the joint has no such sensor"
    return WiredSensor(
        joint,
        f"{cell.joint_names[joint]}.{channel.leaf}",
        sensor,
        card,
        channel.number,
        card.codec.bits,
        channel_scale(cell, card, channel),
        rank * (card.channel_us * 1e-6),
        cell.joints[joint].motor.gear_ratio,
    )
