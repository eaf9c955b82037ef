"""The bus in words for the screen: rows of frames, of the log, of nodes, and the line of figures. Pure functions."""

from collections.abc import Sequence

from canarm_protocol.canopen.frames import Frame, NmtState
from canarm_protocol.decoding import Meaning
from canarm_protocol.decoding.services import emergency_text, state_name

from ..link import Link, LinkState
from ..texts import ABSENT, Tone, Word
from .load import Load
from .nodes import NodeNow
from .rows import RowNow
from .store import BusNow

CHANGED_NS = 1_000_000_000
"""Bytes that have changed are marked for so long."""
BUSY = 0.8
"""A load from here on is marked: arbitration leaves the lowest priorities little."""
SILENT_PERIODS = 3
LEAST_SILENCE_NS = 1_000_000_000
_STATES = {
    NmtState.OPERATIONAL: Word("● operational", Tone.GOOD),
    NmtState.PRE_OPERATIONAL: Word("○ pre-operational"),
    NmtState.STOPPED: Word("■ stopped", Tone.WARNING),
    NmtState.BOOT_UP: Word("… boot-up"),
}


def identifier_text(frame: Frame) -> str:
    """The identifier in hexadecimal, as wide as its sort; of error frames a word."""
    if frame.is_error:
        return "error"
    return f"{frame.can_id:08X}" if frame.is_extended else f"{frame.can_id:03X}"


def data_words(frame: Frame, changed: int, is_fresh: bool) -> list[Word]:
    """The bytes in hexadecimal; those that a bit of `changed` falls into are marked while that `is_fresh`."""
    if frame.is_remote:
        return [Word(f"remote, asks for {len(frame.data)}", Tone.DIM)]
    words = []
    for place, octet in enumerate(frame.data):
        is_changed = is_fresh and changed >> 8 * place & 0xFF
        if place:
            words.append(Word(" "))
        words.append(Word(f"{octet:02X}", Tone.CHANGED if is_changed else Tone.PLAIN))
    return words


def rate_text(rate_hz: float) -> str:
    """Frames a second in at most six characters."""
    if rate_hz == 0.0:
        return ABSENT
    return f"{rate_hz:.0f}" if rate_hz >= 99.5 else f"{rate_hz:.1f}"


def period_text(period_ns: int | None) -> str:
    """A period in ms, or in s where it is long."""
    if period_ns is None:
        return ABSENT
    return f"{period_ns * 1e-9:.2f} s" if period_ns >= 10_000_000_000 else f"{period_ns * 1e-6:.2f}"


def meaning_words(meaning: Meaning) -> list[Word]:
    """What a frame means: its title, then what it says."""
    tone = Tone.BAD if meaning.is_wrong else Tone.PLAIN
    words = [Word(meaning.title, Tone.BAD if meaning.is_wrong else Tone.GOOD)]
    if meaning.text:
        words.append(Word(f"  {meaning.text}", tone))
    if meaning.is_wrong:
        words.insert(0, Word("▲ ", Tone.BAD))
    return words


def row_cells(row: RowNow, meaning: Meaning, wall_ns: int) -> tuple[Sequence[Word], ...]:
    """Identifier, count, rate, period, data, meaning."""
    is_fresh = wall_ns - row.changed_wall_ns < CHANGED_NS
    return (
        (Word(identifier_text(row.frame)),),
        (Word(str(row.times), Tone.DIM),),
        (Word(rate_text(row.rate_hz)),),
        (Word(period_text(row.period_ns), Tone.DIM),),
        data_words(row.frame, row.changed, is_fresh),
        meaning_words(meaning),
    )


def load_word(load: Load) -> Word:
    """How busy the bus is."""
    if load.share is None:
        return Word("load –", Tone.DIM)
    tone = Tone.WARNING if load.share >= BUSY else Tone.PLAIN
    return Word(f"{'▲ ' if tone is Tone.WARNING else ''}load {100.0 * load.share:.1f} %", tone)


def figure_words(now: BusNow, link: Link, shown: int, filter_text: str) -> tuple[Word, ...]:
    """Load, frames, identifiers, and what did not fit: errors, malformed input, identifiers that are not kept."""
    rate = now.load.frames_per_s
    words = [
        load_word(now.load),
        Word(f"{ABSENT if rate is None else round(rate)} frames/s"),
        Word(f"{shown} of {len(now.rows)} identifiers" if filter_text else f"{len(now.rows)} identifiers", Tone.DIM),
    ]
    discarded = link.counted
    for name, count in (
        ("error frames", now.errors + discarded.error_frames),
        ("malformed", discarded.malformed),
        ("FD frames", discarded.fd_frames),
        ("not kept", now.untracked),
    ):
        if count or name == "error frames":
            words.append(Word(f"{'▲ ' if count else ''}{name} {count}", Tone.WARNING if count else Tone.DIM))
    words.append(Word(f"{now.received} frames", Tone.DIM))
    if filter_text:
        words.insert(0, Word(f"filter: {filter_text}", Tone.WARNING))
    return tuple(words)


def state_words(link: Link, now: BusNow, wall_ns: int, is_behind: bool = False) -> tuple[Word, ...]:
    """The connection, and how long ago the last frame was; of a record, whether it is still being read."""
    if link.state is LinkState.CONNECTING:
        return (Word("… opening", Tone.WARNING),)
    if link.state is LinkState.LOST:
        state = Word("✖ lost" if link.connections else "✖ not connected", Tone.BAD)
        return state, Word(f"{link.reason or link.where}; trying again every second", Tone.BAD)
    if not link.is_live:
        return (Word("… reading the log", Tone.WARNING) if is_behind else Word("▶ recorded"),)
    if not now.received:
        return (Word("○ no frame since this view was opened", Tone.WARNING),)
    age_s = (wall_ns - now.wall_ns) * 1e-9
    if age_s > 1.0:
        return Word("● connected", Tone.GOOD), Word(f"▲ last frame {age_s:.0f} s ago", Tone.WARNING)
    return (Word("● connected", Tone.GOOD),)


def node_cells(node: NodeNow, wall_ns: int) -> tuple[Sequence[Word], ...]:
    """Node-ID, name, state, heartbeat age, error register, last EMCY, boots, identity."""
    state = Word(ABSENT, Tone.DIM)
    if node.state is not None:
        known = node.state in set(NmtState)
        state = _STATES[NmtState(node.state)] if known else Word(f"▲ state 0x{node.state:02X}", Tone.BAD)
        said = state.text.partition(" ")[2]
        if node.is_told:
            state = Word(f"» {said}")
        elif _is_silent(node, wall_ns):
            state = Word(f"was {said}", Tone.DIM)
    register = Word(ABSENT, Tone.DIM)
    if node.register is not None:
        register = Word(f"0x{node.register:02X}", Tone.BAD if node.register else Tone.PLAIN)
    vendor, product = (ABSENT if number is None else f"{number:X}" for number in node.identity)
    heard = "" if node.is_identity_heard else " EDS"
    identity = Word(ABSENT, Tone.DIM) if node.identity == (None, None) else Word(f"{vendor}:{product}{heard}", Tone.DIM)
    return (
        (Word(f"0x{node.node_id:02X}"),),
        (Word(node.name),),
        (state,),
        (_age_word(node, wall_ns),),
        (register,),
        (_emergency_word(node),),
        (Word(str(node.boots), Tone.DIM),),
        (identity,),
    )


def _is_silent(node: NodeNow, wall_ns: int) -> bool:
    """Whether `SILENT_PERIODS` heartbeats are missing."""
    period_ns, heard_ns = node.heartbeat_period_ns, node.heartbeat_wall_ns
    if period_ns is None or heard_ns is None:
        return False
    return wall_ns - heard_ns > max(LEAST_SILENCE_NS, SILENT_PERIODS * period_ns)


def _age_word(node: NodeNow, wall_ns: int) -> Word:
    if node.heartbeat_wall_ns is None:
        return Word(ABSENT, Tone.DIM)
    age_ns = wall_ns - node.heartbeat_wall_ns
    text = f"{age_ns * 1e-9:.1f} s"
    if _is_silent(node, wall_ns):
        return Word(f"▲ {text}", Tone.WARNING)
    return Word(text)


def _emergency_word(node: NodeNow) -> Word:
    if node.code is None:
        return Word(ABSENT, Tone.DIM)
    text = f"0x{node.code:04X} {emergency_text(node.code)}"
    return Word(f"▲ {text}", Tone.BAD) if node.code else Word(text)


def node_state_text(state: int | None) -> str:
    """A node's state in words."""
    if state is None:
        return "not heard"
    return state_name(NmtState(state)) if state in set(NmtState) else f"state 0x{state:02X}"
