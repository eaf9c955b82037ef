"""The text of a new cell: what was planned and sized, with a comment at each assumed value.

The arithmetic belongs to `sizing.py`, `cards.py` and `timing.py`; here it becomes a file that people read and change.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from canarm_protocol.cell.cell_file import parse_cell
from canarm_protocol.cell.model import Cell

from .cards import CONVERSION_US, PlannedCard, plan_cards
from .gains import control_tables
from .request import Arm, ArmJoint, Request
from .sizing import (
    GEAR_EFFICIENCY,
    GEAR_RATIO,
    HOLD_SHARE,
    DriveSize,
    Friction,
    size_drives,
)
from .timing import compute_delay_us, fitting_cycle_us, heartbeat_ms

FULL_SCALE_V = 5.0
NOISE_LSB = 0.3
FASTEST_RAD_S = 2.5
"""Assumed highest speed of a joint: konkuk1's."""
ENCODER_LINES = 2048
COUNTER_BITS = 16
MOST_TURNS = 2 ** (COUNTER_BITS - 1) / (4 * ENCODER_LINES)
SPARE_DEG = 5.0
"""How far a position sensor sees beyond the limits at either end."""
MOST_STEP_US = 650
COLUMN = 46
"""Column of the comments, if the value leaves room."""

ENDLESS = DriveSize(0.0, 0.0, 1e6, 1e6, 1e-6, 1e-3, 1e-3, 0.0, 0.0, 1e6, 1e6, 1e9)
"""A placeholder drive while the arm is measured: it never lacks torque."""


def write_cell(arm: Arm, request: Request, folder: Path) -> tuple[str, Cell]:
    """The TOML text of a cell for `arm`, and the cell itself; a URDF file is relative to `folder`.

    Raises `NewCellError` if something does not fit, and `CellError` or `ControllerError` for an impossible arm.
    """
    cards = plan_cards([joint.name for joint in arm.joints], request.sensing, request.bits)

    def text(sizes: Sequence[DriveSize], cycle_us: int, control: Mapping[str, Mapping[str, Any]]) -> str:
        return "\n".join(_lines(arm, request, cards, sizes, cycle_us, control))

    def cell(*parts: Any) -> Cell:
        return parse_cell(text(*parts), arm.name, folder=folder)

    endless = [ENDLESS] * len(arm.joints)
    cycle_us = fitting_cycle_us(request, lambda cycle_us: cell(endless, cycle_us, control_tables(None, cycle_us)))
    rough = control_tables(None, cycle_us)
    friction = [Friction(joint.viscous_nm_s, joint.coulomb_nm) for joint in arm.joints]
    sizes = size_drives(cell(endless, cycle_us, rough), friction, [_fastest(joint) for joint in arm.joints])
    control = control_tables(cell(sizes, cycle_us, rough), cycle_us)
    return text(sizes, cycle_us, control), cell(sizes, cycle_us, control)


def _lines(
    arm: Arm,
    request: Request,
    cards: Sequence[PlannedCard],
    sizes: Sequence[DriveSize],
    cycle_us: int,
    control: Mapping[str, Mapping[str, Any]],
) -> list[str]:
    lines = [
        f"# {arm.title}. Written by canarm new-cell; it is yours now: change what you know better.",
        '# "assumed" marks what the arm does not say. After a change: canarm check --cell THIS_FILE.',
        "# A motor or sensor that is mounted the other way round: sign = -1 in its table.",
        "",
        _value("name", arm.name),
        _value("title", arm.title),
        "",
        *_bus(request, cycle_us),
        "",
        "[physics]",
        _value("max_step_us", min(MOST_STEP_US, cycle_us // 2), "of the emulated arm's motion"),
    ]
    for name, table in control.items():
        lines += ["", f"[{name}]", *(_value(key, value) for key, value in table.items())]
    lines += [
        "",
        "[[robot]]",
        _value("name", arm.name),
        _value("number", 1),
        _value("gravity_m_s2", (0.0, 0.0, -9.81), "in the base's own frame: z is up"),
    ]
    if arm.urdf is not None:
        lines.append(_value("urdf", arm.urdf, "bodies, axes and limits; relative to this file"))
    for joint, size in zip(arm.joints, sizes, strict=True):
        lines += _joint(joint, size, request)
    lines += ["", "# Cards: node-ID = 0x10 x robot number + slot."]
    for card in cards:
        lines += _card(card, arm.name, request)
    return [*lines, ""]


def _bus(request: Request, cycle_us: int) -> list[str]:
    own_ms = heartbeat_ms(cycle_us)
    note = "period of SYNC" if request.cycle_us or cycle_us == 2500 else "period of SYNC; 2500 does not fit"
    return [
        "[bus]",
        _value("bitrate", request.bitrate, "bit/s"),
        _value("cycle_us", cycle_us, note),
        _value("heartbeat_ms", own_ms, "of the controller and of every card"),
        _value("heartbeat_timeout_ms", 5 * own_ms, "silence after which cards and controller act"),
        _value("controller_node_id", 1),
        "bench_node_id = 0x70",
        _value("compute_delay_us", compute_delay_us(cycle_us), "from the last input to the outputs, assumed"),
    ]


def _joint(joint: ArmJoint, size: DriveSize, request: Request) -> list[str]:
    low, high = joint.limits_deg
    lines = ["", "[[robot.joint]]", _value("name", joint.name, joint.comment)]
    lines.append(_value("home_deg", joint.home_deg, "where the arm stands at power-on, assumed"))
    if joint.states_limits:
        lines.append(_value("limits_deg", (low, high), "assumed"))
    if joint.speed_rad_s is not None:
        lines.append(_value("max_speed_rad_s", joint.speed_rad_s, "the arm's description; no motion may be faster"))
    if joint.body is not None:
        lines += ["", "[robot.joint.body]", *(_value(key, value) for key, value in joint.body.items())]
    hold = f"holding takes {size.hold_nm:.3g} N m at worst, the built-in motions {size.motion_nm:.3g} N m"
    unused = []
    if joint.effort_nm is not None:
        unused.append(f"# effort limit of the arm's description, not used: {joint.effort_nm:g} N m")
    stated = {
        key: "of the arm's description" for key, value in (("v", joint.viscous_nm_s), ("c", joint.coulomb_nm)) if value
    }
    lines += [
        "",
        *unused,
        f"[robot.joint.motor]  # {size.torque_nm:.3g} N m at the joint: {hold}",
        _value("torque_constant_nm_a", size.torque_constant_nm_a, "assumed: torque / (gear x efficiency x current)"),
        _value("gear_ratio", GEAR_RATIO, "assumed"),
        _value("gear_efficiency", GEAR_EFFICIENCY, "assumed"),
        _value("rotor_inertia_kg_m2", size.rotor_inertia_kg_m2, "assumed: 1.25e-4 for each N m of the motor"),
        _value("winding_ohm", size.winding_ohm, "assumed: a quarter of the supply at the greatest current"),
        _value("winding_mh", size.winding_mh, "assumed: 0.5 ms"),
        _value("viscous_friction_nm_s", size.viscous_nm_s, stated.get("v", "assumed: 2 % of the torque at full speed")),
        _value("coulomb_friction_nm", size.coulomb_nm, stated.get("c", "assumed: 2.5 % of the torque")),
        _value("wire_stiffness_nm_rad", size.stiffness_nm_rad, "assumed; used when the drive wire is elastic"),
        "",
        "[robot.joint.drive]",
        _value("kind", "d669"),
        _value("max_current_a", size.max_current_a, f"at most {100 * HOLD_SHARE:g} % of it holds the arm in any pose"),
        _value("supply_v", size.supply_v, "assumed: full speed at the greatest current"),
        _value("opamp_full_scale_v", 15.0),
    ]
    for kind in request.sensing:
        lines += ["", f"[robot.joint.sensors.{kind}]", *SENSOR_LINES[kind](joint, size)]
    return lines


def _potentiometer(joint: ArmJoint, size: DriveSize) -> list[str]:
    low, high = joint.limits_deg
    range_deg = 10.0 * -(-(high - low + 2.0 * SPARE_DEG) // 10.0)
    zero_v = FULL_SCALE_V * (0.5 - 0.5 * (low + high) / range_deg)
    return [
        _value("range_deg", range_deg, "assumed: the travel and some more at either end"),
        _value("zero_v", zero_v, "at 0 degrees, assumed: the middle of the travel is the middle of the range"),
        *_analogue(),
    ]


def _encoder(joint: ArmJoint, size: DriveSize) -> list[str]:
    return [
        _value("lines", ENCODER_LINES, "a turn of the joint, assumed; the counter counts four edges of each"),
        _value("shaft", "joint", "its count is 0 at home_deg, where the arm stands at power-on"),
    ]


def _tachometer(joint: ArmJoint, size: DriveSize) -> list[str]:
    note = "of joint speed, either way; " + ("assumed" if joint.speed_rad_s is None else "the joint's greatest")
    return [_value("full_scale_rad_s", _fastest(joint), note), _value("zero_v", 0.5 * FULL_SCALE_V), *_analogue()]


def _current_sense(joint: ArmJoint, size: DriveSize) -> list[str]:
    return [_value("full_scale_a", size.max_current_a), *_analogue()]


def _analogue() -> list[str]:
    return [_value("full_scale_v", FULL_SCALE_V), _value("noise_lsb", NOISE_LSB, "assumed")]


SENSOR_LINES = {
    "potentiometer": _potentiometer,
    "encoder": _encoder,
    "tachometer": _tachometer,
    "current_sense": _current_sense,
}
"""The lines for each kind of sensor."""


def _card(card: PlannedCard, robot: str, request: Request) -> list[str]:
    lines = [
        "",
        "[[card]]",
        _value("name", card.name),
        _value("model", card.model),
        _value("robot", robot),
        _value("slot", card.slot),
        f"node_id = 0x{0x10 + card.slot:02X}",
    ]
    if card.model in ("adc", "adc0809"):
        lines.append(_value("conversion_us", CONVERSION_US, "for each channel"))
    if card.model == "encoder_counter":
        lines.append(_value("counter_bits", COUNTER_BITS, f"{MOST_TURNS:g} turns either way; four channels in a frame"))
    if card.model in ("dac", "adc"):
        lines.append(_value("bits", request.bits))
    wires = [f'    {{ number = {place}, signal = "{signal}" }},' for place, signal in enumerate(card.signals, 1)]
    return [*lines, "channel = [", *wires, "]"]


def _fastest(joint: ArmJoint) -> float:
    return joint.speed_rad_s or FASTEST_RAD_S


def _value(key: str, value: Any, comment: str = "") -> str:
    """A line of the file: floats with significant digits only."""
    line = f"{key} = {_toml(value)}"
    return f"{line:<{COLUMN}} # {comment}" if comment else line


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return f"{value:_}"
    if isinstance(value, float):
        text = f"{value:.4g}"
        return text if any(mark in text for mark in ".en") else f"{text}.0"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return f"[{', '.join(map(_toml, value))}]"
