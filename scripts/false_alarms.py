#!/usr/bin/env python3
"""Rate of false alarms of the controller's supervision: fault-free runs over seeds, laws, motions and payloads.

python scripts/false_alarms.py [--runs 1000] [--seed 0]: one table per law; exit status 1 if anything was detected.
"""

import argparse
import multiprocessing
import random
import sys
from collections import Counter
from typing import NamedTuple

from canarm.session import make_bench, make_controller
from canarm_controller.run.state import State
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock

LAWS = ("pd", "computed-torque", "mras", "mras-lyapunov", "slotine-li")
TRAJECTORIES = ("sine", "trapezoid")
WORKERS = 2
SHORTEST_S, LONGEST_S = 4.0, 10.0
PAYLOAD_SHARE = 0.5
"""The true mass of the last link differs from the nominal by at most this share."""


class Draw(NamedTuple):
    """One run."""

    law: str
    trajectory: str
    mass_kg: float
    seconds: float
    seed: int


def draws(count: int, seed: int) -> list[Draw]:
    """`count` runs; all laws and trajectories equally often, the rest drawn from `seed`."""
    generator = random.Random(seed)
    nominal_kg = load_cell("konkuk1").joints[-1].mass_kg
    kinds = [(law, trajectory) for law in LAWS for trajectory in TRAJECTORIES]
    return [
        Draw(
            *kinds[number % len(kinds)],
            mass_kg=nominal_kg * generator.uniform(1.0 - PAYLOAD_SHARE, 1.0 + PAYLOAD_SHARE),
            seconds=generator.uniform(SHORTEST_S, LONGEST_S),
            seed=generator.randrange(2**31),
        )
        for number in range(count)
    ]


def run(draw: Draw) -> tuple[Draw, list[str]]:
    """The detections of one run in virtual time; there should be none."""
    cell = load_cell("konkuk1")
    truth = {f"{cell.joint_names[-1]}.mass": repr(draw.mass_kg)}
    bench = make_bench(cell, truth, Clock.SYNC, draw.seed)
    ticks = round(draw.seconds / cell.bus.cycle_s)
    controller = make_controller(cell, draw.law, draw.trajectory, None, Clock.SYNC, ticks)
    bench.start()
    bench.records.clear()
    controller.begin(0)
    while not controller.is_finished:
        frames, controller.outbox = controller.outbox, []
        for frame in frames:
            bench.receive(frame, controller)
        if not frames and controller.deadline_ns is not None:
            controller.time_out(controller.deadline_ns)
        records, bench.records = bench.records, []
        bench.bench_records.clear()
        for time_ns, frame, origin in records:
            if origin is None:
                controller.receive(frame, time_ns)
    alarms = [f"{each} (tick {each.tick})" for each in controller.detections]
    if controller.state is not State.DONE and not alarms:
        alarms.append(str(controller.reason))
    return draw, alarms


def main() -> int:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    runs: Counter[str] = Counter()
    false: Counter[str] = Counter()
    virtual_s = 0.0
    with multiprocessing.Pool(WORKERS) as pool:
        for draw, alarms in pool.imap_unordered(run, draws(options.runs, options.seed), chunksize=4):
            runs[draw.law] += 1
            virtual_s += draw.seconds
            if alarms:
                false[draw.law] += 1
                print(f"{draw}: {'; '.join(alarms)}", flush=True)
    print(f"{'law':16} {'runs':>6} {'false alarms':>13}")
    for law in LAWS:
        print(f"{law:16} {runs[law]:6} {false[law]:13}")
    print(f"{'all':16} {runs.total():6} {false.total():13}   in {virtual_s:.0f} s of virtual time")
    return 1 if false else 0


if __name__ == "__main__":
    sys.exit(main())
