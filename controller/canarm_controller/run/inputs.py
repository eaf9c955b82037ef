"""What the cards measure, as the loop needs it: codes of a cycle in, position, speed and current of each joint out.

Owns scales, sampling times, and substitutes for sensors that a joint does not have. Reference, law and commands must
not enter.
"""

from collections.abc import Mapping, Sequence
from math import radians
from typing import Self

from canarm_protocol.cell.model import Cell, Quantity
from canarm_protocol.cell.sensing import JointSensors, WiredSensor, joint_sensors
from canarm_protocol.cell.sensors.base import AnalogueSensor
from canarm_protocol.cell.wiring import InputSlot

from ..cycle import Cycle
from ..dynamics import Arm, ClosedChain
from ..estimation.speed_observer import SpeedObserver
from ..supervision.nominal import sensor_nominal
from ..supervision.thresholds import range_rad

BYTE_BITS = 8


class JointInputs:
    """Scales of all joints. `slots` gives the quantity of each of the `codes` in `take`.

    A joint without a tachometer gets its speed from a `SpeedObserver`; one without a current sense has the commanded
    current. Their codes are 0.
    """

    def __init__(self, cell: Cell, slots: Sequence[InputSlot], arm: Arm) -> None:
        sensors = joint_sensors(cell)
        places = {(slot.joint, slot.quantity): place for place, slot in enumerate(slots)}
        self._sensors = sensors
        self._scales = [(each.position.scale.zero, each.position.scale.step) for each in sensors]
        self._stops_rad = [(radians(joint.limits_deg[0]), radians(joint.limits_deg[1])) for joint in cell.joints]
        self._ranges_rad = [
            range_rad(joint, sensor_nominal(each.position), cell.supervision)
            for joint, each in zip(cell.joints, sensors, strict=True)
        ]
        self._positions = [_channel(places, joint, each.position) for joint, each in enumerate(sensors)]
        self._others = [
            (joint, *_channel(places, joint, each.velocity)[:3], *_channel(places, joint, each.current)[:3])
            for joint, each in enumerate(sensors)
            if each.velocity is not None or each.current is not None
        ]
        """Joints of which more than the position is measured; of speed and then of current: place, code at 0, step."""
        self._without_speed = [joint for joint, each in enumerate(sensors) if each.velocity is None]
        self._without_current = [
            (joint, arm.torque_per_ampere[joint]) for joint, each in enumerate(sensors) if each.current is None
        ]
        self._no_codes, self._no_rates = [0] * len(sensors), [0.0] * len(sensors)
        self._observer = (
            SpeedObserver(
                arm,
                self._without_speed,
                _noises_rad(sensors),
                cell.control.observer,
                cell.bus.cycle_s,
                ClosedChain.of(cell),
                [joint.fastest_rad_s for joint in cell.joints],
            )
            if self._without_speed
            else None
        )
        self._shifts = None if all(_is_byte(wired) for each in sensors for wired in _logged(each)) else _shifts(sensors)
        self.angle_codes: list[int] = []
        self.speed_codes: list[int] = []
        self.current_codes: list[int] = []

    def start(self, position_codes: Sequence[int]) -> tuple[float, ...]:
        """The pose (rad) at which the arm rests, from one position code per joint; observers start there.

        A joint that noise puts a little beyond a stop rests on that stop.
        """
        codes = zip(position_codes, self._scales, strict=True)
        measured = [(code - zero) * step for code, (zero, step) in codes]
        pose = tuple(map(resting_rad, measured, self._stops_rad, self._ranges_rad))
        if self._observer is not None:
            self._observer.start(pose)
        return pose

    def rezero(self, zeros: Mapping[int, float]) -> tuple[float, ...]:
        """Other zeros (counts) of the position scales of some joints. Returns by how much every angle grows, rad."""
        shift_rad = [0.0] * len(self._scales)
        for joint, zero in zeros.items():
            before, step = self._scales[joint]
            shift_rad[joint] = (before - zero) * step
            self._scales[joint] = zero, step
            place, _, _, skew_s = self._positions[joint]
            self._positions[joint] = place, zero, step, skew_s
        if self._observer is not None:
            self._observer.shift(shift_rad)
        return tuple(shift_rad)

    def take_over(self, before: Self) -> None:
        """Go on, at rest, with what another one has of the same joints: scales, and the codes of the last cycle."""
        self._scales, self._positions = before._scales, before._positions
        self.angle_codes, self.speed_codes = before.angle_codes, before.speed_codes
        self.current_codes = before.current_codes
        self.start(self.angle_codes)

    def take(self, codes: Sequence[int], cycle: Cycle, signs: Sequence[float]) -> None:
        """Put one cycle's measurements into `cycle`; `signs` are those of the commanded currents.

        An ADC converts one channel after the other; positions are referred back to the time of SYNC by the speed.
        """
        angles: list[int] = []
        positions: list[float] = []
        for place, zero, step, _ in self._positions:
            code = codes[place]
            angles.append(code)
            positions.append((code - zero) * step)
        speeds, currents = self._no_codes.copy(), self._no_codes.copy()
        velocities, amperes = self._no_rates.copy(), self._no_rates.copy()
        for joint, place, zero, step, current, no_current, ampere in self._others:
            code = speeds[joint] = codes[place]
            velocities[joint] = (code - zero) * step
            code = currents[joint] = codes[current]
            amperes[joint] = signs[joint] * (code - no_current) * ampere
        observer = self._observer
        velocity = tuple(velocities) if observer is None else observer.predicted(velocities)
        rows = zip(positions, self._positions, velocity, strict=True)
        cycle.position_rad = position = tuple([angle - channel[3] * rate for angle, channel, rate in rows])
        if observer is not None:
            velocity = observer.update(position, velocity, cycle.applied_nm)
            for joint in self._without_speed:
                speeds[joint] = 0
        cycle.velocity_rad_s = velocity
        self.angle_codes, self.speed_codes, self.current_codes = angles, speeds, currents
        for joint, per_ampere in self._without_current:
            amperes[joint] = cycle.applied_nm[joint] / per_ampere
            currents[joint] = 0
        cycle.current_a = tuple(amperes)

    def log_bytes(self) -> tuple[Sequence[int], Sequence[int]]:
        """Positions and speeds of the last cycle as bytes: a converter's upper eight bits, a count's lower eight."""
        if self._shifts is None:
            return self.angle_codes, self.speed_codes
        angles, speeds = self._shifts
        return (
            [code >> shift & 0xFF for code, shift in zip(self.angle_codes, angles, strict=True)],
            [code >> shift & 0xFF for code, shift in zip(self.speed_codes, speeds, strict=True)],
        )

    def skew_s(self, joint: int, quantity: Quantity) -> float:
        """Time from SYNC to the sample of the joint's quantity; 0 without a sensor."""
        wired = self._sensors[joint].measuring(quantity)
        return 0.0 if wired is None else wired.skew_s


def resting_rad(measured_rad: float, stops_rad: tuple[float, float], within_rad: tuple[float, float]) -> float:
    """Angle at which a joint rests: the measured one, or the stop if it is beyond it but within the measuring range."""
    low, high = stops_rad
    if within_rad[0] <= measured_rad <= within_rad[1]:
        return min(max(measured_rad, low), high)
    return measured_rad


Channel = tuple[int, float, float, float]
"""Index among the codes, code at 0, step in rad, rad/s or A, and s after SYNC."""


def _channel(places: dict[tuple[int, Quantity], int], joint: int, wired: WiredSensor | None) -> Channel:
    """The joint's channel; without such a sensor, one that always gives 0."""
    if wired is None:
        return 0, 0.0, 0.0, 0.0
    return places[joint, wired.quantity], wired.scale.zero, wired.scale.step, wired.skew_s


def _noises_rad(sensors: Sequence[JointSensors]) -> list[float]:
    """Standard deviation of one sample of each joint's position: noise and rounding, rad."""
    found = []
    for each in sensors:
        sensor = each.position.sensor
        noise_lsb = sensor.noise_lsb if isinstance(sensor, AnalogueSensor) else 0.0
        found.append(each.position.scale.lsb * (noise_lsb**2 + 1.0 / 12.0) ** 0.5)
    return found


def _logged(sensors: JointSensors) -> list[WiredSensor]:
    return [wired for wired in (sensors.position, sensors.velocity) if wired is not None]


def _is_byte(wired: WiredSensor) -> bool:
    return isinstance(wired.sensor, AnalogueSensor) and wired.bits == BYTE_BITS


def _shift(wired: WiredSensor | None) -> int:
    return wired.bits - BYTE_BITS if wired is not None and isinstance(wired.sensor, AnalogueSensor) else 0


def _shifts(sensors: Sequence[JointSensors]) -> tuple[list[int], list[int]]:
    return [_shift(each.position) for each in sensors], [_shift(each.velocity) for each in sensors]
