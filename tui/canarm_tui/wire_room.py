"""What the view of the wire has besides the bench's figures: the cell's traffic by analysis, and past loads.

Pure functions from values to lines of words.
"""

from collections.abc import Sequence

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.schedulability import bus_load, cell_messages, response_times

from .texts import Tone, Word

Line = Sequence[Word]
BLOCKS = " ▁▂▃▄▅▆▇█"
MOST_ROWS, LEAST_ROWS = 12, 3
"""Of the picture of past loads, without its two lines of words."""


def traffic_lines(cell: Cell) -> list[Line]:
    """The cyclic frames of `cell` by priority: worst-case response against its limit, after Davis et al. (2007)."""
    messages = cell_messages(cell)
    load = 100.0 * bus_load(messages, cell.bus.bitrate)
    width = max(len(message.name) for message in messages)
    lines: list[Line] = [
        [Word(f"cyclic frames of {cell.name}, worst cases by analysis: load {load:.1f} %")],
        [Word(f"ID  {'frame':<{width}} {'bits':>5} {'every ms':>9} {'response ms':>12}  within", Tone.DIM)],
    ]
    for message, worst_ns in ((each.message, each.worst_ns) for each in response_times(messages, cell.bus.bitrate)):
        head = f"{message.can_id:03X} {message.name:<{width}} {message.bits:>5} {message.period_ns * 1e-6:>9.2f} "
        if worst_ns is None or worst_ns > message.limit_ns:
            text = "not bounded" if worst_ns is None else f"{worst_ns * 1e-6:.3f}"
            lines.append([Word(head), Word(f"▲ {text:>10}  beyond {message.limit_ns * 1e-6:.2f}", Tone.WARNING)])
        else:
            share = 100.0 * worst_ns / message.limit_ns
            lines.append([Word(f"{head}{worst_ns * 1e-6:>12.3f}  {share:.0f} % of {message.limit_ns * 1e-6:.2f}")])
    return lines


def load_lines(loads: Sequence[float], width: int, rows: int) -> list[Line]:
    """Loads (0 to 1), one a column, the newest at the right, in `rows` lines up to the next full 10 %."""
    shown = list(loads)[-width:]
    top = min(1.0, max(1, -int(-max(shown) * 10 // 1)) / 10.0)
    lines: list[Line] = [[Word(f"load of each second that this was looked at, up to {100 * top:.0f} %", Tone.DIM)]]
    eighths = [round(min(load / top, 1.0) * rows * 8) for load in shown]
    drawn = ("".join(BLOCKS[min(max(each - 8 * row, 0), 8)] for each in eighths) for row in range(rows - 1, -1, -1))
    return [*lines, *([Word(text)] for text in drawn)]


def fitted(lines: Sequence[Line], further: Sequence[Sequence[Line]], rows: int) -> list[Line]:
    """`lines`, and those of `further` that fit as a whole, with an empty line between them."""
    shown = list(lines)
    for block in further:
        if block and len(shown) + 1 + len(block) <= rows:
            shown += [[], *block]
    return shown
