"""The dashboard's texts: a snapshot and the state of the link as words, numbers with units, and a tone for each.

Pure functions. A tone becomes a colour elsewhere, and never alone carries a meaning.
"""

import math
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple, Protocol

from canarm_protocol.cell.bench_objects import CONTROLLER_STATES

from .link import LinkState
from .signals import LIMIT_LSB
from .snapshot import Counters, JointNow, Rates, Report, Snapshot

STALE_NS = 500_000_000
"""Telemetry older than this is shown as stale."""
REPORT_STALE_NS = 2_000_000_000
"""The controller reports a few times per second; a state older than this is shown as stale."""
SEPARATOR = " │ "
ABSENT = "–"


class Connection(Protocol):
    """What is said of a bus."""

    where: str
    state: LinkState
    reason: str | None
    connections: int


class Tone(Enum):
    """What a text means for the reader."""

    PLAIN = "plain"
    DIM = "dim"
    GOOD = "good"
    WARNING = "warning"
    BAD = "bad"
    CHANGED = "changed"
    """Another value than shortly before."""


class Word(NamedTuple):
    """A piece of text and its tone."""

    text: str
    tone: Tone = Tone.PLAIN


_STATE_WORDS = {
    "running": Word("▶ running", Tone.GOOD),
    "homing": Word("… homing", Tone.PLAIN),
    "bringing up": Word("… bringing up", Tone.PLAIN),
    "stopping": Word("▼ stopping", Tone.WARNING),
    "done": Word("✓ done", Tone.GOOD),
    "failed": Word("✖ failed", Tone.BAD),
}


def link_word(link: Connection, snapshot: Snapshot, is_starting: bool = False) -> Word:
    """The state of the connection and its data; that there is none is no wonder while a run is being started."""
    if snapshot.replay:
        return Word(snapshot.replay)
    if is_starting and link.state is not LinkState.CONNECTED:
        return Word("… starting a run", Tone.WARNING)
    if link.state is LinkState.CONNECTING:
        return Word("… connecting", Tone.WARNING)
    if link.state is LinkState.LOST:
        return Word("✖ lost" if link.connections else "✖ not connected", Tone.BAD)
    if snapshot.age_ns is None:
        return Word("○ no data", Tone.WARNING)
    return Word("● connected", Tone.GOOD)


def state_word(report: Report | None) -> Word:
    """The controller's state, or that it is lost."""
    if report is None:
        return Word("controller –", Tone.DIM)
    name = CONTROLLER_STATES.get(report.state, f"state {report.state}")
    word = _STATE_WORDS.get(name, Word(name))
    if report.is_lost:
        return Word("✖ controller lost", Tone.BAD)
    is_over = name in ("done", "failed")
    if report.age_ns > REPORT_STALE_NS and not is_over:
        return Word(f"{word.text} (stale)", Tone.WARNING)
    return word


def rate_word(rates: Rates | None) -> Word:
    """Cycles per second, on both clocks if they differ."""
    if rates is None:
        return Word(f"{ABSENT} cycles/s", Tone.DIM)
    wall = rates.cycles_per_wall_s
    if math.isnan(rates.cycles_per_s) or abs(rates.cycles_per_s - wall) < 0.05 * wall:
        return Word(f"{wall:.0f} cycles/s")
    return Word(f"{rates.cycles_per_s:.0f} cycles/s ({wall:.0f} wall)")


def real_time_word(rates: Rates | None) -> Word:
    """How many seconds of the run pass per second."""
    return (
        Word(f"{ABSENT} × real time", Tone.DIM) if rates is None else Word(f"{rates.real_time_factor:.2f} × real time")
    )


def age_word(age_ns: int | None) -> Word:
    """How old the data are."""
    if age_ns is None:
        return Word(f"age {ABSENT}", Tone.DIM)
    if age_ns > STALE_NS:
        return Word(f"▲ stale {age_ns * 1e-9:.1f} s", Tone.WARNING)
    return Word(f"age {age_ns * 1e-9:.2f} s")


def length_of(words: Sequence[Word]) -> int:
    """Characters of a line of them, with separators."""
    return sum(len(word.text) for word in words) + len(SEPARATOR) * (len(words) - 1)


def notice(link: Connection, snapshot: Snapshot, is_starting: bool = False) -> Word | None:
    """What the reader should know about the connection, or None if all is well."""
    if is_starting and link.state is not LinkState.CONNECTED:
        return Word("another run is being started: what is left of the last one has ended", Tone.DIM)
    if link.state is LinkState.LOST:
        return Word(f"{link.reason or link.where}; trying again every second", Tone.BAD)
    if link.state is LinkState.CONNECTING:
        return Word(f"opening {link.where}", Tone.DIM)
    if snapshot.age_ns is None:
        return Word(f"{link.where}: no telemetry yet; is this the bench bus of a running emulator?", Tone.WARNING)
    return None


def counter_words(counters: Counters, discarded: int, width: int) -> tuple[Word, ...]:
    """Counts of frames and samples; `discarded` is the port's. Zeros are left out if space is short."""

    def count(name: str, value: int) -> Word:
        return Word(f"{name} {value}", Tone.WARNING if value else Tone.DIM)

    words = (
        Word(f"frames {counters.received}", Tone.DIM),
        count("dropped samples", counters.dropped_samples),
        count("dropped references", counters.dropped_references),
        count("unknown", counters.unknown),
        count("malformed", counters.malformed),
        count("discarded", discarded),
    )
    if length_of(words) <= width:
        return words
    return words[0], *(word for word in words[1:] if word.tone is Tone.WARNING)


def trace_words(name: str, joint: JointNow) -> tuple[Word, ...]:
    """The title of an error trace."""
    if math.isnan(joint.max_lsb):
        return Word(f"{name} error"), Word("no reference yet", Tone.DIM)
    limit = f"±{LIMIT_LSB:g} LSB"
    verdict = Word(f"✓ within {limit}", Tone.GOOD)
    if math.isnan(joint.error_lsb):
        verdict = Word("no reference any more", Tone.DIM)
    elif joint.max_lsb > LIMIT_LSB:
        verdict = Word(f"▲ beyond {limit}", Tone.WARNING)
    return (
        Word(f"{name} error {number(joint.error_lsb, 2)} LSB"),
        verdict,
        Word(f"rms {joint.rms_lsb:.2f}", Tone.DIM),
        Word(f"max {joint.max_lsb:.2f}", Tone.DIM),
    )


def number(value: float, decimals: int, signed: bool = True) -> str:
    """A number with a full-width sign, or a dash for NaN; never "−0.00"."""
    if not math.isfinite(value):
        return ABSENT
    text = f"{value:.{decimals}f}" if abs(value) < 1e6 else f"{value:.1e}"
    if float(text) == 0.0:
        text = text.removeprefix("-")
    elif signed and value > 0.0:
        text = f"+{text}"
    return text.replace("-", "−")
