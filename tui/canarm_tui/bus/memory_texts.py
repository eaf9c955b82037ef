"""The memory image as lines: each page with its play position, and the bytes around it."""

import itertools
from collections.abc import Sequence

from ..texts import Tone, Word
from .memory_mirror import SAMPLES, MemoryMirror, PageNow

BLOCKS = " ▁▂▃▄▅▆▇█"
HEAD_WIDTH = 32
FEWEST, MOST = 8, 128
BYTES_HEAD, BYTES_IN_A_ROW = 9, 16
"""Characters before the bytes of a row; rows have one or several times so many."""


def memory_lines(mirror: MemoryMirror, names: Sequence[str], width: int, per_page: int = 2) -> list[list[Word]]:
    """`per_page` lines for each: how high its bytes are, in parts, with the position; and the bytes around that."""
    lines: list[list[Word]] = []
    position = None if mirror.cycle is None or mirror.cycle < 0 else mirror.cycle % SAMPLES
    for page in mirror.pages:
        parts = min(MOST, max(FEWEST, width - HEAD_WIDTH))
        head = f"${page.address:04X} {page.title} {names[page.joint]}"
        lines.append([Word(f"{head:<{HEAD_WIDTH - 1}.{HEAD_WIDTH - 1}} "), *_bar(page, parts, position)])
        if position is not None and per_page > 1:
            lines += _bytes(page, position, per_page - 1, width)
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


def _bytes(page: PageNow, position: int, rows: int, width: int) -> list[list[Word]]:
    a_row = BYTES_IN_A_ROW * max(1, (width - BYTES_HEAD) // (3 * BYTES_IN_A_ROW))
    first = max(0, min(position - rows * a_row // 2, SAMPLES - rows * a_row))
    lines = []
    for begin in range(first, min(first + rows * a_row, SAMPLES), a_row):
        words = [Word(f"  ${page.address + begin:04X}: ", Tone.DIM)]
        row = slice(begin, min(begin + a_row, SAMPLES))
        octets = zip(itertools.count(begin), page.data[row].tolist(), page.is_known[row].tolist(), strict=False)
        toned = [
            (
                Tone.CHANGED if at == position else Tone.PLAIN if is_known else Tone.DIM,
                f"{data:02X}" if is_known else "··",
            )
            for at, data, is_known in octets
        ]
        # Few words: each takes long to draw.
        for tone, texts in itertools.groupby(toned, key=lambda each: each[0]):
            words += [Word(" ".join(text for _, text in texts), tone), Word(" ")]
        lines.append(words)
    return lines
