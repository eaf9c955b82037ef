"""The header line: how the run is doing, what runs and where, in as many words as there is room for.

Pure functions. Words stand in a fixed order; where room is short, the least important ones go first.
"""

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from canarm_protocol.cell.bench_objects import CONTROLLER_STATES, ENDED
from canarm_protocol.cell.model import Cell
from canarm_protocol.shown import printable

from .snapshot import Report, Snapshot
from .texts import (
    ABSENT,
    SEPARATOR,
    STALE_NS,
    Connection,
    Tone,
    Word,
    age_word,
    length_of,
    link_word,
    rate_word,
    real_time_word,
    state_word,
)

FULL = 0.8
"""A bus that is loaded more than that has little room for bursts."""
LONGEST_NAME = 24
LEAST_PLACE = 18
"""The bus is left out if it would be cut shorter than "-i canarm -c bench"."""
NOT_RECORDED = "not recorded"
"""How the bench's object of the record begins where nothing can be recorded."""
_HOST_AND_PORT = re.compile(r"\bhost=(\S+) port=(\d+)")
LONGEST_STOP_S = 1.0
"""A run that is longer than planned by more than its stop has begun with something else: no length is said of it."""
ALWAYS = 99
"""The rank of what stays as long as anything does."""


class _Piece(NamedTuple):
    word: Word
    rank: int
    """Of two that do not both fit, the one with the lower rank goes."""


def late_word(report: Report | None) -> Word:
    """The controller's cycles that were begun late or missed, of both together: its summary has a number for each."""
    if report is None:
        return Word(f"late+missed {ABSENT}", Tone.DIM)
    return Word(f"▲ late+missed {report.late}", Tone.WARNING) if report.late else Word("late+missed 0")


def load_words(snapshot: Snapshot) -> tuple[Word, ...]:
    """The load of the robot's bus as its wire model has it, while a run goes on; nothing without a model."""
    bus, report = snapshot.bus, snapshot.report
    if bus is None or math.isnan(bus.load) or snapshot.rates is None:
        return ()
    if report is not None and CONTROLLER_STATES.get(report.state) in ENDED:
        return ()
    errors = f", {bus.error_frames} error frames" if bus.error_frames else ""
    return (Word(f"wire {100.0 * bus.load:.0f} %{errors}", Tone.WARNING if errors or bus.load > FULL else Tone.PLAIN),)


def record_words(recording: tuple[bool, str] | None) -> tuple[Word, ...]:
    """Whether the bench records; nothing where it never can."""
    if recording is None or (not recording[0] and recording[1].startswith(NOT_RECORDED)):
        return ()
    return (Word("● rec", Tone.GOOD) if recording[0] else Word("○ not recorded", Tone.WARNING),)


def clock_words(snapshot: Snapshot) -> tuple[Word, ...]:
    """Whose clock the run has, and the pace that is set for it."""
    plan = snapshot.plan
    if plan is None:
        return ()
    if not plan.is_lockstep:
        return (Word("wall clock"),)
    if plan.pace is None:
        return (Word("lockstep"),)
    return (Word("lockstep max" if math.isinf(plan.pace) else f"lockstep {plan.pace:g} ×"),)


def time_words(snapshot: Snapshot, cycle_s: float) -> tuple[Word, ...]:
    """How long the run has lasted, of how long it is to last where that is known."""
    if snapshot.run_ticks is None:
        return ()
    at_s, length_s = snapshot.run_ticks * cycle_s, 0.0 if snapshot.plan is None else snapshot.plan.ticks * cycle_s
    if not length_s or at_s > length_s + LONGEST_STOP_S:
        return (Word(f"{at_s:.1f} s"),)
    return (Word(f"{min(at_s, length_s):.1f}/{length_s:g} s"),)


def header_words(
    link: Connection,
    snapshot: Snapshot,
    is_paused: bool,
    width: int,
    cell: Cell,
    recording: tuple[bool, str] | None = None,
    is_starting: bool = False,
) -> tuple[Word, ...]:
    """The header line for `width` columns; `is_starting`: another run is being started."""
    pieces = [_Piece(link_word(link, snapshot, is_starting), ALWAYS)]
    if snapshot.faults is not None and snapshot.faults.is_stopped:
        pieces.append(_Piece(Word("■ EMERGENCY STOP", Tone.BAD), ALWAYS))
    if is_paused:
        pieces.append(_Piece(Word("⏸ paused", Tone.WARNING), ALWAYS))
    if not snapshot.replay:
        pieces += _live(snapshot, cell.bus.cycle_s, record_words(recording))
    names = ((cell.name, 8), (snapshot.law, 7))
    pieces += (_Piece(Word(printable(name, LONGEST_NAME), Tone.DIM), rank) for name, rank in names if name)
    while len(pieces) > 2 and length_of([piece.word for piece in pieces]) > width:
        pieces.remove(min(reversed(pieces), key=lambda piece: piece.rank))
    words = [piece.word for piece in pieces]
    where, room = _address(link.where), width - length_of(words) - len(SEPARATOR)
    if room >= min(len(where), LEAST_PLACE):
        words.append(Word(where if len(where) <= room else f"{where[: room - 1]}…", Tone.DIM))
    return tuple(words)


def _live(snapshot: Snapshot, cycle_s: float, recorded: Sequence[Word]) -> list[_Piece]:
    is_fresh = snapshot.age_ns is not None and snapshot.age_ns <= STALE_NS
    late, age = late_word(snapshot.report), age_word(snapshot.age_ns)
    lost = [word for word in recorded if word.tone is not Tone.GOOD]
    ranked = (
        (ALWAYS, [state_word(snapshot.report), *lost]),
        (11, time_words(snapshot, cycle_s)),
        (10, clock_words(snapshot)),
        (1 if is_fresh else 12, [age]),
        (6 if late.tone is not Tone.WARNING else 13, [late]),
        (3, [rate_word(snapshot.rates)]),
        (4, [real_time_word(snapshot.rates)]),
        (5, load_words(snapshot)),
        (9, [word for word in recorded if word not in lost]),
    )
    return [_Piece(word, rank) for rank, words in ranked for word in words]


def _address(where: str) -> str:
    """HOST:PORT of a bus on the network, as `--connect` takes it; other buses unchanged."""
    found = _HOST_AND_PORT.search(where)
    return f"{found[1]}:{found[2]}" if found else where
