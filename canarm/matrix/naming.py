"""Whether a detection names the right part: which detectors fit which faults. Kept by hand.

"Named right" is about the first detection alone: its detector is one that fits, and it speaks of the fault's joint.
Faults of cards, bus and clock are not judged: a lost card has the same effects as a failed drive or sensor.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from fnmatch import fnmatchcase

from canarm_emulator.faults.declaration import Tap, TapKind
from canarm_emulator.faults.taps import taps_of
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import wired_sensors

from .evidence import Notice
from .plan import MatrixCell

DEFINITION = (
    "named right",
    "The first detection fits the fault: its detector is one of those listed for the part that has failed, and it "
    "speaks of the fault's joint. Cards, bus, clock and strange controllers are not asked.",
)


class Part(StrEnum):
    """The failed part, as a mechanic would name it."""

    DRIVE = "drives"
    POTENTIOMETER = "potentiometers"
    ENCODER = "encoders"
    TACHOMETER = "tachometers"
    CURRENT_SENSE = "current senses"
    MECHANICS = "mechanics"

    @property
    def aim(self) -> float:
        """The share that is to be named right."""
        return 0.8 if self is Part.MECHANICS else 0.95


@dataclass(frozen=True, slots=True)
class Fitting:
    """Patterns of a fault, and of the detectors that fit it. `reaches_inward`: joints nearer the base bear it too."""

    part: Part
    fault: str
    detectors: tuple[str, ...]
    reaches_inward: bool = False


_RESTLESS = "sensor-noise"
FITTING: tuple[Fitting, ...] = (
    # The sense sees magnitudes: of a wrong direction or a weak motor only the arm tells.
    Fitting(Part.DRIVE, "*", ("current-mismatch", "wrong-direction", "drive-broken")),
    Fitting(Part.DRIVE, "reversed-direction", ("acceleration-mismatch",)),
    Fitting(Part.DRIVE, "latch-bit-stuck", ("acceleration-mismatch",)),
    Fitting(Part.DRIVE, "winding-short", ("acceleration-mismatch",)),
    Fitting(Part.DRIVE, "loss-of-torque-constant", ("acceleration-mismatch",)),
    Fitting(Part.DRIVE, "current-limit", ("saturation",)),
    Fitting(Part.DRIVE, "supply-undervoltage", ("saturation",)),
    Fitting(Part.POTENTIOMETER, "*", ("potentiometer-*", "impossible-position", "impossible-motion")),
    Fitting(Part.ENCODER, "*", ("encoder-*", "impossible-position", "impossible-motion", "homing-failed")),
    Fitting(Part.TACHOMETER, "*", ("tachometer-*",)),
    Fitting(Part.CURRENT_SENSE, "*", ("current-sense-*",)),
    *(
        Fitting(part, fault, (_RESTLESS,))
        for part in (Part.POTENTIOMETER, Part.ENCODER, Part.TACHOMETER, Part.CURRENT_SENSE)
        for fault in ("noise", "spike", "dropout", "intermittent", "loose-contact", "stuck-bit")
        if (part, fault) != (Part.ENCODER, "loose-contact")  # a counter's wires have no such tap
    ),
    Fitting(Part.MECHANICS, "*", ("acceleration-mismatch", "following-error", "saturation")),
    Fitting(Part.MECHANICS, "payload-change", ("acceleration-mismatch", "saturation"), reaches_inward=True),
    Fitting(Part.MECHANICS, "wire-*", ("drive-broken", "overspeed")),
    Fitting(Part.MECHANICS, "backlash", ("drive-broken",)),
)
"""All entries that cover a fault count."""

_DRIVE = (TapKind.DAC_CODE, TapKind.LATCH, TapKind.OPAMP, TapKind.CURRENT, TapKind.SUPPLY, TapKind.MOTOR)
_MECHANICS = (TapKind.LINK, TapKind.DRIVE_WIRE, TapKind.BRAKE)
_OF_A_SENSOR = {
    "potentiometer": Part.POTENTIOMETER,
    "encoder": Part.ENCODER,
    "tachometer": Part.TACHOMETER,
    "current_sense": Part.CURRENT_SENSE,
}
"""By the kinds of sensor of a cell."""


def part_of(cell: Cell, fault: MatrixCell) -> Part | None:
    """The part that a fault is a failure of; None for cards, bus and clock."""
    tap = _taps(cell).get(fault.tap)
    return None if tap is None else _part(cell, tap)


def is_named_right(cell: Cell, fault: MatrixCell, first: Notice) -> bool | None:
    """Whether the first detection names the failed part and its joint; None if that is not judged."""
    tap = _taps(cell).get(fault.tap)
    part = None if tap is None else _part(cell, tap)
    if tap is None or part is None:
        return None
    return any(
        first.where in _places(cell, tap.joint, each.reaches_inward)
        and any(fnmatchcase(first.detector, pattern) for pattern in each.detectors)
        for each in FITTING
        if each.part is part and fnmatchcase(fault.fault, each.fault)
    )


@functools.lru_cache(maxsize=4)
def _taps(cell: Cell) -> dict[str, Tap]:
    return taps_of(cell)


def _part(cell: Cell, tap: Tap) -> Part | None:
    if tap.is_of_a_hand:
        return None
    if tap.kind in _DRIVE:
        return Part.DRIVE
    if tap.kind in _MECHANICS:
        return Part.MECHANICS
    for sensor in wired_sensors(cell):
        is_pin = tap.kind is TapKind.SENSOR and tap.name == sensor.signal
        is_code = tap.kind is TapKind.ADC_CODE and (tap.node_id, tap.channel) == (sensor.card.node_id, sensor.channel)
        if is_pin or is_code:
            return _OF_A_SENSOR[sensor.sensor.kind]
    return None


def _places(cell: Cell, joint: int, reaches_inward: bool) -> Sequence[str]:
    """Name of the joint, and of those nearer to its arm's base if they count."""
    first = joint
    if reaches_inward:
        first = max(block.start for block in cell.blocks if block.start <= joint)
    return cell.joint_names[first : joint + 1]
