"""The dashboard's texts: a snapshot and the state of the link as words, numbers with units, and a tone for each.

Pure functions. A tone becomes a colour elsewhere, and never alone carries a meaning.
"""

import math
import re
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple, Protocol

from canarm_protocol.cell.bench_objects import CONTROLLER_STATES
from canarm_protocol.shown import printable

from .link import LinkState
from .signals import LIMIT_LSB
from .snapshot import BusNow, Counters, JointNow, Rates, Report, Snapshot

STALE_NS = 500_000_000
"""Telemetry older than this is shown as stale."""
REPORT_STALE_NS = 2_000_000_000
"""The controller reports a few times per second; a state older than this is shown as stale."""
SEPARATOR = " │ "
FULL = 0.8
"""A bus that is loaded more than that has little room for bursts."""
LONGEST_NAME = 24
LEAST_PLACE = 18
"""The bus is left out if it would be cut shorter than "-i canarm -c bench"."""
_HOST_AND_PORT = re.compile(r"\bhost=(\S+) port=(\d+)")
ABSENT = "–"
NOT_RECORDED = "not recorded"
"""How the bench's object of the record begins where nothing can be recorded."""


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


def link_word(link: Connection, snapshot: Snapshot) -> Word:
    """The state of the connection and its data."""
    if snapshot.replay:
        return Word(snapshot.replay)
    if link.state is LinkState.CONNECTING:
        return Word("… connecting", Tone.WARNING)
    if link.state is LinkState.LOST:
        return Word("✖ lost" if link.connections else "✖ not connected", Tone.BAD)
    if snapshot.age_ns is None:
        return Word("○ no data", Tone.WARNING)
    return Word("● connected", Tone.GOOD)


def state_word(report: Report | None, bench_lives: bool = True) -> Word:
    """The controller's state; that it is lost is known only while the bench sends."""
    if report is None:
        return Word("controller –", Tone.DIM)
    name = CONTROLLER_STATES.get(report.state, f"state {report.state}")
    word = _STATE_WORDS.get(name, Word(name))
    if bench_lives and report.is_lost:
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


def late_word(report: Report | None) -> Word:
    """The controller's late cycles."""
    if report is None:
        return Word(f"late {ABSENT}", Tone.DIM)
    return Word(f"▲ late {report.late}", Tone.WARNING) if report.late else Word("late 0")


def age_word(age_ns: int | None) -> Word:
    """How old the data are."""
    if age_ns is None:
        return Word(f"age {ABSENT}", Tone.DIM)
    if age_ns > STALE_NS:
        return Word(f"▲ stale {age_ns * 1e-9:.1f} s", Tone.WARNING)
    return Word(f"age {age_ns * 1e-9:.2f} s")


def load_word(bus: BusNow | None) -> tuple[Word, ...]:
    """The load of the robot's bus, where a wire model knows it."""
    if bus is None or math.isnan(bus.load):
        return ()
    errors = f", {bus.error_frames} error frames" if bus.error_frames else ""
    return (Word(f"bus {100.0 * bus.load:.0f} %{errors}", Tone.WARNING if errors or bus.load > FULL else Tone.PLAIN),)


def record_word(recording: tuple[bool, str] | None) -> tuple[Word, ...]:
    """Whether the bench records; nothing where it never can."""
    if recording is None or (not recording[0] and recording[1].startswith(NOT_RECORDED)):
        return ()
    return (Word("● rec", Tone.GOOD) if recording[0] else Word("○ not recorded", Tone.WARNING),)


def header_words(
    link: Connection,
    snapshot: Snapshot,
    is_paused: bool,
    width: int,
    what: Sequence[str] = (),
    recording: tuple[bool, str] | None = None,
) -> tuple[Word, ...]:
    """The header line for `width` columns; what does not fit is cut from the end, where the bus is named.

    `what` are words for what runs, such as the cell and the clock; the law stands with them once it is known.
    """
    live = (
        state_word(snapshot.report, snapshot.age_ns is not None and snapshot.age_ns <= STALE_NS),
        age_word(snapshot.age_ns),
        late_word(snapshot.report),
        rate_word(snapshot.rates),
        real_time_word(snapshot.rates),
        *load_word(snapshot.bus),
    )
    recorded = record_word(recording)
    if recorded and recorded[0].tone is Tone.GOOD:
        live += recorded
    else:
        live = live[:1] + recorded + live[1:]
    words = [
        link_word(link, snapshot),
        *(() if snapshot.replay else live),
        *(Word(printable(each, LONGEST_NAME), Tone.DIM) for each in (*what, snapshot.law) if each),
    ]
    if is_paused:
        words.insert(1, Word("⏸ paused", Tone.WARNING))
    if snapshot.faults is not None and snapshot.faults.is_stopped:
        words.insert(1, Word("■ EMERGENCY STOP", Tone.BAD))
    while len(words) > 2 and _length(words) > width:
        words.pop()
    room = width - _length(words) - len(SEPARATOR)
    where = link.where if len(link.where) <= room else _address(link.where)
    if room >= min(len(where), LEAST_PLACE):
        words.append(Word(where if len(where) <= room else f"{where[: room - 1]}…", Tone.DIM))
    return tuple(words)


def _address(where: str) -> str:
    """HOST:PORT of a bus on the network, as `--connect` takes it; other buses unchanged."""
    found = _HOST_AND_PORT.search(where)
    return f"{found[1]}:{found[2]}" if found else where


def _length(words: Sequence[Word]) -> int:
    return sum(len(word.text) for word in words) + len(SEPARATOR) * (len(words) - 1)


def notice(link: Connection, snapshot: Snapshot) -> Word | None:
    """What the reader should know about the connection, or None if all is well."""
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
    if _length(words) <= width:
        return words
    return words[0], *(word for word in words[1:] if word.tone is Tone.WARNING)


def trace_words(name: str, joint: JointNow) -> tuple[Word, ...]:
    """The title of an error trace."""
    if math.isnan(joint.max_lsb):
        return Word(f"{name} error"), Word("no reference yet", Tone.DIM)
    limit = f"±{LIMIT_LSB:g} LSB"
    verdict = Word(f"✓ within {limit}", Tone.GOOD)
    if joint.max_lsb > LIMIT_LSB:
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
