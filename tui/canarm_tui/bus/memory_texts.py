"""The memory image as lines: each page with its play position, and the bytes around it."""

from collections.abc import Sequence

from ..texts import Tone, Word
from .memory_mirror import SAMPLES, MemoryMirror, PageNow

BLOCKS = " ▁▂▃▄▅▆▇█"
HEAD_WIDTH = 32
FEWEST, MOST = 8, 128
AROUND = 8
"""Bytes before and after the play position."""


def memory_lines(mirror: MemoryMirror, names: Sequence[str], width: int) -> list[list[Word]]:
    """Two lines per page: how high its bytes are, in so many parts, with the position; and the bytes around that."""
    lines: list[list[Word]] = []
    position = None if mirror.cycle is None or mirror.cycle < 0 else mirror.cycle % SAMPLES
    for page in mirror.pages:
        parts = min(MOST, max(FEWEST, width - HEAD_WIDTH))
        head = f"${page.address:04X} {page.title} {names[page.joint]}"
        lines.append([Word(f"{head:<{HEAD_WIDTH - 1}.{HEAD_WIDTH - 1}} "), *_bar(page, parts, position)])
        if position is not None:
            lines.append(_bytes(page, position))
    return lines


def position_word(mirror: MemoryMirror) -> Word:
    """Where the controller writes now."""
    if mirror.cycle is None or mirror.cycle < 0:
        return Word("memory: no run is followed", Tone.DIM)
    return Word(f"memory: sample {mirror.cycle % SAMPLES} of {SAMPLES}, cycle {mirror.cycle}")


def _bar(page: PageNow, parts: int, position: int | None) -> list[Word]:
    size = -(-SAMPLES // parts)
    words: list[Word] = []
    for first in range(0, SAMPLES, size):
        known = page.is_known[first : first + size]
        mean = int(page.data[first : first + size][known].mean()) if known.any() else 0
        sign = BLOCKS[1 + mean * (len(BLOCKS) - 2) // 255] if known.any() else "·"
        if position is not None and first <= position < first + size:
            words.append(Word("▼", Tone.CHANGED))
        else:
            words.append(Word(sign, Tone.PLAIN if known.any() else Tone.DIM))
    return words


def _bytes(page: PageNow, position: int) -> list[Word]:
    first = max(0, min(position - AROUND, SAMPLES - 2 * AROUND))
    words = [Word(f"  ${page.address + first:04X}: ", Tone.DIM)]
    for place in range(first, first + 2 * AROUND):
        text = f"{page.data[place]:02X}" if page.is_known[place] else "··"
        tone = Tone.CHANGED if place == position else Tone.PLAIN if page.is_known[place] else Tone.DIM
        words += [Word(text, tone), Word(" ")]
    return words
