"""The dashboard's texts about a joint: the columns of the table of joints, and a row of it. Pure functions."""

import math
from dataclasses import dataclass

from .signals import LIMIT_LSB
from .snapshot import JointNow
from .texts import ABSENT, Tone, Word, number


@dataclass(frozen=True, slots=True)
class JointColumn:
    """A column of the table, shown from `least` columns of the terminal on."""

    title: str
    width: int
    least: int = 0


COLUMNS = (
    JointColumn("ref. °", 8),
    JointColumn("true °", 8),
    JointColumn("meas. °", 8),
    JointColumn("error LSB", 10),
    JointColumn("RMS LSB", 9, 100),
    JointColumn("rad/s", 8),
    JointColumn("motor A", 8),
    JointColumn("of limit", 10),
    JointColumn("command A", 11, 120),
    JointColumn("DAC", 5),
    JointColumn("turn", 5),
    JointColumn("", 14, 110),
)
"""After the name; the last one is one of the law's own values, under its name."""


def columns_for(width: int) -> tuple[JointColumn, ...]:
    """Those that are shown at `width`."""
    return tuple(column for column in COLUMNS if width >= column.least)


def joint_words(joint: JointNow, columns: tuple[JointColumn, ...], inner: int) -> tuple[Word, ...]:
    """A row, without the name; `inner` is the law's own value that is shown."""
    value = joint.internals[inner] if inner < len(joint.internals) else math.nan
    words = (
        Word(number(math.degrees(joint.reference_rad), 2)),
        Word(number(math.degrees(joint.angle_rad), 2)),
        Word(number(math.degrees(joint.measured_rad), 2)),
        error_word(joint.error_lsb),
        Word(number(joint.rms_lsb, 2, signed=False)),
        Word(number(joint.speed_rad_s, 3)),
        Word(number(joint.current_a, 3)),
        limit_word(joint),
        Word(number(joint.command_a, 3)),
        Word(ABSENT if joint.code is None else str(joint.code)),
        turn_word(joint),
        Word(number(value, 4)),
    )
    return tuple(word for word, column in zip(words, COLUMNS, strict=True) if column in columns)


def error_word(error_lsb: float) -> Word:
    """The error, marked beyond `LIMIT_LSB`."""
    if abs(error_lsb) > LIMIT_LSB:
        return Word(f"▲ {number(error_lsb, 2)}", Tone.WARNING)
    return Word(number(error_lsb, 2))


def limit_word(joint: JointNow) -> Word:
    """The motor's current as a share of the amplifier's limit, and on which side a command is at it."""
    share = abs(joint.current_a) / joint.limit_a
    if not math.isfinite(share):
        return Word(ABSENT, Tone.DIM)
    text = f"{min(100.0 * share, 999.0):.0f} %"
    if joint.saturation == 0:
        return Word(text)
    return Word(f"▲ {text} {'+' if joint.saturation > 0 else '−'}", Tone.WARNING)


def turn_word(joint: JointNow) -> Word:
    """The way in which the bridge is told to turn: counter-clockwise is +."""
    if math.isnan(joint.command_a):
        return Word(ABSENT, Tone.DIM)
    return Word("+" if joint.command_a > 0.0 else "−" if joint.command_a < 0.0 else "off")
