"""Where the CPU time of a cycle goes: konkuk1 in one process, detectors on, split into the parts of the bench.

Each part is given again, alone, what it got in a run (`replay`); what is only there in the whole is the difference of
two such times, and carries the noise of both. Blocks alternate. Times are ratios to a yardstick, a loop of plain
Python that is measured in every block: it has the speed of the machine at that moment, and never changes.
"""

import statistics
from collections.abc import Mapping, Sequence

import replay
from measure import Ratio, Row, yardstick_s

CELL = "konkuk1"
CYCLES = 800
BLOCKS = 9
YARDSTICK = "yardstick: 1000 rounds of plain Python"


def rows(blocks: int = BLOCKS, cycles: int = CYCLES) -> list[Row]:
    """The whole, and its parts, which add up to it."""
    run = replay.record(CELL, cycles)
    yard_s: list[float] = []
    split: dict[str, list[float]] = {}
    for _ in range(blocks):
        yard_s.append(yardstick_s())
        for name, part_s in parts(run).items():
            split.setdefault(name, []).append(part_s / cycles)
    return table(split, yard_s)


def parts(run: replay.Recorded) -> dict[str, float]:
    """Seconds of CPU of all cycles of `run`, of the whole and of each part."""
    whole, bench, controller = replay.rig_s(run), replay.bench_s(run), replay.controller_s(run)
    cards_and_world, world = replay.cards_and_world_s(run), replay.world_s(run)
    physics, loop, figures = replay.physics_s(run), replay.loop_s(run), replay.assessor_s(run)
    return {
        "cycle (rig)": whole,
        "physics": physics,
        "electrics": world - physics,
        "cards and slaves": cards_and_world - world,
        "bus": bench - cards_and_world - figures,
        "controller": loop,
        "supervision": controller - loop,
        "bookkeeping": whole - bench - controller + figures,
    }


def table(split: Mapping[str, Sequence[float]], yard_s: Sequence[float]) -> list[Row]:
    """A row for each part of `split`, in s per cycle, block by block; the first is the whole."""
    whole_s = next(iter(split.values()))
    found = []
    for name, cycle_s in split.items():
        shares = [100.0 * part / whole for part, whole in zip(cycle_s, whole_s, strict=True)]
        remark = f"{statistics.median(cycle_s) * 1e6:.1f} us a cycle, {statistics.median(shares):.0f} %"
        found.append(Row(f"CPU: {name}", YARDSTICK, Ratio.of(cycle_s, yard_s), "", remark))
    return found
