"""How a controller reacts to a fault, as seen on the bus, without knowing how it works.

They count as the detections of a foreign controller.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from canarm_protocol.canopen.frames import Cob, Emergency, NmtCommand, NmtState, parse_nmt
from canarm_protocol.cards import Wire
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.errors import FrameError

from .evidence import Evidence, Floats, Ints, Notice, Received

ZERO_CYCLES = 4
"""Outputs that are zero for this many frames in a row are off; a current that changes sign passes zero faster."""
OUTPUTS_ZERO, NMT_STOP, EMERGENCY, HEARTBEAT, ENDED, SILENT = (
    "outputs-zero",
    "nmt-stop",
    "emergency",
    "heartbeat-stopped",
    "process-ended",
    "silent",
)
END_OF_DRIVING = (NMT_STOP, HEARTBEAT, ENDED, SILENT)
"""Reactions after which a controller no longer drives; zero outputs and errors may be temporary."""
SAME_CYCLES = ZERO_CYCLES
"""Reactions of run and twin within this many cycles of each other are the same: a pause may shift their time."""


def reactions(cell: Cell, frames: Sequence[Received], cycle: Ints, time_s: Floats) -> list[Notice]:
    """All reactions in `frames`, in order of time; `cycle` and `time_s` are those of the SYNCs.

    Outputs zero: every DAC code zero in `ZERO_CYCLES` frames in a row, from the first of them. NMT stop: a command that
    ends OPERATIONAL. Emergency: EMCY of the controller's node. Heartbeat: the controller's, in a state other than
    OPERATIONAL.
    """
    node_id = cell.bus.controller_node_id
    found: list[tuple[float, str, str]] = [(stamp_s, OUTPUTS_ZERO, "") for stamp_s in _zero_outputs(cell, frames)]
    for stamp_s, frame in frames:
        if frame.can_id == Cob.NMT and _ends_operation(frame.data):
            found.append((stamp_s, NMT_STOP, f"0x{frame.data[1]:02X}" if frame.data[1] else "all"))
        elif frame.can_id == Cob.EMERGENCY + node_id and _is_error(frame.data):
            found.append((stamp_s, EMERGENCY, f"0x{node_id:02X}"))
        elif frame.can_id == Cob.HEARTBEAT + node_id and frame.data[:1] == bytes((NmtState.STOPPED,)):
            found.append((stamp_s, HEARTBEAT, f"0x{node_id:02X}"))
    return [
        Notice(name, where, cycle_at(stamp_s, cycle, time_s), name, stops=True)
        for stamp_s, name, where in sorted(found)
    ]


def beside_twin(run: Evidence, twin: Evidence) -> Evidence:
    """The run without what its fault-free twin also does at the same time: that is no reaction to the fault."""
    notices = tuple(each for each in run.notices if not any(is_same(each, its) for its in twin.notices))
    is_running = not any(each.stops and each.cycle >= run.injected_cycle for each in notices)
    return replace(run, notices=notices, is_running=is_running)


def is_same(mine: Notice, its: Notice) -> bool:
    """Whether run and twin have noticed the same, or done the same, then and there."""
    return (mine.detector, mine.where) == (its.detector, its.where) and abs(mine.cycle - its.cycle) <= SAME_CYCLES


def cycle_at(stamp_s: float, cycle: Ints, time_s: Floats) -> int:
    """The cycle at time stamp `stamp_s`."""
    return int(cycle[max(int(np.searchsorted(time_s, stamp_s, side="right")) - 1, 0)])


def _zero_outputs(cell: Cell, frames: Iterable[Received]) -> list[float]:
    """When the outputs of all joints went to zero for at least `ZERO_CYCLES` frames; with several DACs, at the last."""
    layouts = {
        layout.cob_id: (layout, node.card.codec)
        for node in card_nodes(cell)
        for layout in node.rpdos
        if node.card.kind.takes is Wire.CURRENT_COMMAND
    }
    since_s: dict[int, float] = {}
    counts = dict.fromkeys(layouts, 0)
    is_off, found = False, []
    for stamp_s, (can_id, data, is_extended, is_remote) in frames:
        if can_id not in layouts or is_extended or is_remote:
            continue
        layout, codec = layouts[can_id]
        if len(data) < layout.size:
            continue
        if any(codec.code(value) for value in layout.unpack(data[: layout.size])):
            counts[can_id], is_off = 0, False
            continue
        counts[can_id] += 1
        if counts[can_id] == 1:
            since_s[can_id] = stamp_s
        if not is_off and all(count >= ZERO_CYCLES for count in counts.values()):
            is_off = True
            found.append(max(since_s.values()))
    return found


def _ends_operation(data: bytes) -> bool:
    try:
        command, _ = parse_nmt(data)
    except FrameError:
        return False
    return command is not NmtCommand.START


def _is_error(data: bytes) -> bool:
    try:
        return Emergency.parse(data).code != 0
    except FrameError:
        return False
