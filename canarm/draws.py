"""Robots drawn from a box: what may differ from nominal, a Latin hypercube over it, and the bound of a proportion.

Owns what a draw means for a cell; the numbers are those that the detectors derive their limits from. What is run with a
draw, and how it is judged, is not known here.
"""

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from canarm_controller.dynamics import cell_arm
from canarm_controller.laws.slotine_li import SlotineLi
from canarm_controller.laws.tuning import suggested_control
from canarm_controller.supervision import uncertainty as box
from canarm_controller.supervision.thresholds import LIGHTEST_SHARE
from canarm_protocol.cell.cell_checks import problems
from canarm_protocol.cell.model import Cell, Control, Motor
from canarm_protocol.errors import CellError

Value = float | int | str

CONFIDENCE = 0.95
BISECTIONS = 60
"""Halvings of the interval 0 to 1: finer than a float resolves."""
HEARTBEAT_CYCLES = 2
"""A heartbeat is sent every second cycle at most."""
SILENT_HEARTBEATS = 2
"""A card is silent for so many heartbeats at least before it is missed."""
SHORT_DELAY_SHARE = 8
"""The compute delay is one cycle over this if the cell's own delay exceeds a fifth of the cycle."""
LATE_CYCLES = 1.5
"""Cycles from a measurement to the middle of the time in which its command acts; the winding adds its time constant."""
LATEST_RAD = math.radians(80.0)
"""How late a law may answer a swing on a wire, as a phase: at 90 degrees nothing of it damps, at 80 a sixth."""
LONGEST_CYCLE_US = 100_000
"""The longest cycle of any cell."""


@dataclass(frozen=True, slots=True)
class Span:
    """A quantity drawn uniformly between two ends; a factor uniformly in its logarithm: half is as likely as twice."""

    name: str
    low: float
    high: float
    unit: str = ""
    is_factor: bool = False

    def at(self, share: float) -> float:
        """The value at a `share` of the way, 0 to 1."""
        if self.is_factor:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + (self.high - self.low) * share

    def __str__(self) -> str:
        sign = "x " if self.is_factor else ""
        return f"{self.name} {sign}{self.low:g} to {self.high:g} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class Choice:
    """One of several values, all equally likely."""

    name: str
    values: tuple[Value, ...]

    def at(self, share: float) -> Value:
        """The value at a `share` of the way, 0 to 1."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]

    def __str__(self) -> str:
        return f"{self.name} {', '.join(map(str, self.values))}"


@dataclass(frozen=True, slots=True)
class Whole:
    """A whole number from `low` to `high`, such as a seed."""

    name: str
    low: int
    high: int

    def at(self, share: float) -> int:
        """The value at a `share` of the way, 0 to 1."""
        return min(self.low + int(share * (self.high - self.low + 1)), self.high)

    def __str__(self) -> str:
        return f"{self.name} {self.low} to {self.high}"


Axis = Span | Choice | Whole

SEED = Whole("seed", 0, 2**31 - 1)
CYCLE_MS = Span("cycle", *box.CYCLE_MS, "ms", is_factor=True)
PAYLOAD = Span("payload", *box.PAYLOAD)
"""How much heavier the last link is than the controller thinks, as a share of its mass."""
JOINT_BOX: tuple[Axis, ...] = (
    Choice("wire", ("rigid", "elastic")),
    Span("wire_stiffness", *box.WIRE, is_factor=True),
    Span("noise", *box.NOISE, is_factor=True),
    Span("coulomb", *box.COULOMB, is_factor=True),
    Span("viscous", *box.VISCOUS, is_factor=True),
    Span("torque_constant", *box.TORQUE_CONSTANT, is_factor=True),
    Span("offset", -box.OFFSET_DEG, box.OFFSET_DEG, "deg"),
    Span("start", -box.START_DEG, box.START_DEG, "deg"),
)
"""Drawn separately for each joint: factors of the cell's nominal values, the error of the potentiometer's zero,
and how far from its home pose the arm is parked."""
LIMIT_MARGIN_DEG = 1.0
"""No arm is parked nearer than this to an end stop."""


def robot_box(cell: Cell) -> list[Axis]:
    """The box for the robots of `cell`: the payload, and the axes of each joint, such as `joint2.coulomb`."""
    axes: list[Axis] = [PAYLOAD]
    for name in cell.joint_names:
        axes += [replace(axis, name=f"{name}.{axis.name}") for axis in JOINT_BOX]
    return axes


def hypercube(axes: Sequence[Axis], count: int, seed: int) -> list[dict[str, Value]]:
    """`count` draws of a Latin hypercube: each axis is cut into `count` slices, and each slice is drawn from once.

    A draw depends on the axis's name and `seed` alone, so adding an axis does not change the others.
    """
    columns = []
    for axis in axes:
        generator = random.Random(f"{seed}/{axis.name}")
        slices = list(range(count))
        generator.shuffle(slices)
        columns.append([axis.at((place + generator.random()) / count) for place in slices])
    names = [axis.name for axis in axes]
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]


def truth_of(cell: Cell, draw: Mapping[str, Value], law: str | None = None) -> dict[str, str]:
    """What `--truth` takes for a draw from `robot_box`; an axis that the draw lacks is nominal.

    A wire is elastic where that is drawn and `law`, or each of the laws, damps its swing with the cycle of `cell`.
    """
    truth: dict[str, str] = {}
    arm = cell_arm(cell.robot, cell.joint_names)
    for name, joint, whole in zip(cell.joint_names, cell.joints, arm.effective_inertia, strict=True):
        motor = joint.motor

        def lay(key: str, value: float | None, owner: str = name) -> None:
            if value is not None:
                truth[f"{owner}.{key}"] = f"{value:.6g}"

        def times(axis: str, nominal: float, owner: str = name) -> float | None:
            factor = draw.get(f"{owner}.{axis}")
            return None if factor is None else float(factor) * nominal

        stiffness = times("wire_stiffness", motor.wire_stiffness_nm_rad) or motor.wire_stiffness_nm_rad
        rate = _damping_rate(cell.control.of_joint(name), law)
        if draw.get(f"{name}.wire") == "elastic" and _is_damped(motor, stiffness, whole, rate, cell.bus.cycle_s):
            truth[f"{name}.wire"] = "1"
            lay("wire_stiffness", stiffness)
        lay("coulomb", times("coulomb", motor.coulomb_friction_nm))
        lay("viscous", times("viscous", motor.viscous_friction_nm_s))
        lay("torque_constant", times("torque_constant", motor.torque_constant_nm_a))
        for sensor in joint.sensors.fitted():
            noise_lsb = getattr(sensor, "noise_lsb", None)
            if noise_lsb is not None:
                lay(f"{sensor.kind}_noise_lsb", times("noise", noise_lsb))
            if sensor.kind == "potentiometer":
                lay("potentiometer_offset_deg", times("offset", 1.0))
        start = draw.get(f"{name}.start")
        if start is not None:
            low, high = joint.limits_deg
            lay("initial_deg", min(max(joint.home_deg + float(start), low + LIMIT_MARGIN_DEG), high - LIMIT_MARGIN_DEG))
    payload = draw.get(PAYLOAD.name)
    if payload is not None:
        truth |= payload_truth(cell, float(payload))
    return truth


def _damping_rate(control: Control, law: str | None) -> float:
    """Torque of a law by speed over the joint's inertia, 1/s; of the quickest law of the cell if None."""
    usual, gains = 2.0 * control.damping_ratio * control.natural_frequency_rad_s, control.slotine_li
    if gains is None or law not in (None, SlotineLi.name):
        return usual
    sliding = gains.error_rate_rad_s + gains.sliding_rate_rad_s
    return max(usual, sliding) if law is None else sliding


def _is_damped(motor: Motor, stiffness_nm_rad: float, whole: float, rate: float, cycle_s: float) -> bool:
    """Whether a law damps the swing on a wire, at the inertia of the whole joint, kg·m², although it acts late.

    A torque by speed that is a quarter of a swing late is one by angle: it makes the swing quicker, as a stiffer wire
    does, and does not damp it.
    """
    latest_rad_s = LATEST_RAD / (LATE_CYCLES * cycle_s + motor.winding_mh * 1e-3 / motor.winding_ohm)
    rotor = motor.reflected_inertia_kg_m2
    by_wire = stiffness_nm_rad * (1.0 / rotor + 1.0 / max(whole - rotor, LIGHTEST_SHARE * whole))
    by_law = box.TORQUE_CONSTANT[1] * rate * whole / rotor * latest_rad_s
    return by_wire + by_law <= latest_rad_s**2


def payload_truth(cell: Cell, share: float) -> dict[str, str]:
    """The key of `--truth` that makes the last link heavier by a `share` of its mass, and its value."""
    return {f"{cell.joint_names[-1]}.mass": f"{cell.joints[-1].mass_kg * (1.0 + share):.6g}"}


def retimed(cell: Cell, cycle_us: int) -> Cell:
    """The same cell with another cycle, and what has to go with it. Raises `CellError`.

    Heartbeat and delay follow where they have to. With a longer cycle the gains are what the laws suggest for it. A
    motor on an elastic wire is lighter than its joint by the share of the rotor, and answers so much faster: the law of
    the highest rates has those of a cycle that is longer by that.
    """
    table = cell.model_dump(exclude_none=True)
    bus = table["bus"]
    own_us, bus["cycle_us"] = bus["cycle_us"], cycle_us
    bus["heartbeat_ms"] = max(bus["heartbeat_ms"], math.ceil(HEARTBEAT_CYCLES * cycle_us / 1000))
    if table["supervision"].get("silent_card_ms") is not None:
        least_ms = SILENT_HEARTBEATS * bus["heartbeat_ms"]
        table["supervision"]["silent_card_ms"] = max(table["supervision"]["silent_card_ms"], least_ms)
    if 5 * bus["compute_delay_us"] > cycle_us:
        bus["compute_delay_us"] = cycle_us // SHORT_DELAY_SHARE
    other = Cell.model_validate(table)
    wrong = list(problems(other))
    if wrong:
        raise CellError("\n".join(f"{cell.name} at {cycle_us} us: {line}" for line in wrong))
    if cycle_us <= own_us:
        return other
    arm = cell_arm(other.robot, other.joint_names)
    lighter = max(whole / rotor for whole, rotor in zip(arm.effective_inertia, arm.rotor_inertia, strict=True))
    bus["cycle_us"] = min(round(cycle_us * lighter), LONGEST_CYCLE_US)
    quickest = suggested_control(Cell.model_validate(table))["control.slotine_li"]
    bus["cycle_us"] = cycle_us
    for name, gains in (suggested_control(other) | {"control.slotine_li": quickest}).items():
        _, _, law = name.partition(".")
        (table["control"].setdefault(law, {}) if law else table["control"]).update(gains)
    return Cell.model_validate(table)


def clopper_pearson(hits: int, count: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """The exact two-sided confidence bounds of a probability after `hits` of `count` (Clopper and Pearson, 1934)."""
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if hits == 0 else _root(lambda p: 1.0 - _at_most(hits - 1, count, p) - tail)
    high = 1.0 if hits == count else _root(lambda p: tail - _at_most(hits, count, p))
    return low, high


def _root(rising: Callable[[float], float]) -> float:
    """The zero between 0 and 1 of an increasing function."""
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if rising(middle) > 0.0 else (middle, high)
    return 0.5 * (low + high)


def _at_most(hits: int, count: int, probability: float) -> float:
    """The binomial distribution: the probability of `hits` or fewer."""
    one, none = math.log(probability), math.log1p(-probability)
    logs = (_log_choose(count, k) + k * one + (count - k) * none for k in range(hits + 1))
    return math.fsum(math.exp(each) for each in logs)


def _log_choose(count: int, hits: int) -> float:
    return math.lgamma(count + 1) - math.lgamma(hits + 1) - math.lgamma(count - hits + 1)
