"""How well `canarm identify` finds drawn robots: payload, friction and torque constants, one 10 s run of `excite` each.

Prints, for every parameter, the largest and the RMS error, and in how many cases the 95 % interval held.
"""

import argparse
import random
import sys
import tempfile
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from canarm.identify.identification import identified
from canarm.identify.physical import USUAL
from canarm.rig.rig import Rig
from canarm.runs.run import Run
from canarm.workers.pool import results_of
from canarm_protocol.cell.cell_file import load_cell

SECONDS = 10.0
PAYLOAD_KG = (0.3, 1.1)
FRICTION = 2.0
"""Friction is drawn between this part and multiple of nominal, evenly in its logarithm."""
TORQUE_CONSTANT = 0.05


@dataclass(frozen=True)
class Found:
    """One parameter of one case: what is true, what was found, and half of the interval."""

    name: str
    true: float
    value: float
    half: float

    @property
    def error(self) -> float:
        """As a share of what is true."""
        return (self.value - self.true) / self.true

    @property
    def holds(self) -> bool:
        """Whether the interval has the truth in it."""
        return abs(self.value - self.true) <= self.half


def truth_of(number: int) -> dict[str, float]:
    """The robot of a case, as `--truth` takes it."""
    chance, truth = random.Random(f"identification/{number}"), {"joint3.mass": 0.0}
    truth["joint3.mass"] = round(chance.uniform(*PAYLOAD_KG), 4)
    cell = load_cell("konkuk1")
    for name, joint in zip(cell.joint_names, cell.joints, strict=True):
        for key, nominal in (
            ("coulomb", joint.motor.coulomb_friction_nm),
            ("viscous", joint.motor.viscous_friction_nm_s),
        ):
            truth[f"{name}.{key}"] = round(nominal * FRICTION ** chance.uniform(-1.0, 1.0), 5)
        constant = joint.motor.torque_constant_nm_a * (1.0 + chance.uniform(-TORQUE_CONSTANT, TORQUE_CONSTANT))
        truth[f"{name}.torque_constant"] = round(constant, 6)
    return truth


def found_in(number: int) -> list[Found]:
    """Run a case with its number as seed, and identify it."""
    warnings.simplefilter("ignore")
    truth = truth_of(number)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run"
        with Rig("konkuk1", law="mras", trajectory="excite", seed=number, truth=truth, out=path) as rig:
            rig.run(SECONDS)
        ((_, _, fit),) = identified(Run(path), USUAL).robots
    return [
        Found(each.parameter.name, truth.get(each.parameter.name, each.parameter.nominal), each.value, each.half)
        for each in fit.estimates
    ]


def lines_of(cases: Iterable[list[Found]]) -> Iterable[str]:
    """The table."""
    columns = list(zip(*cases, strict=True))
    yield "| parameter | largest error | RMS error | 95 % interval held |"
    yield "|---|---|---|---|"
    for each in columns:
        errors = np.abs([case.error for case in each])
        held = sum(case.holds for case in each)
        rms = float(np.sqrt(np.mean(errors**2)))
        yield f"| {each[0].name} | {errors.max():.2%} | {rms:.2%} | {held} of {len(each)} |"


def main() -> int:
    """Run the cases and print the table. Exit status 1 if the figures of docs/identify.md no longer hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100, help="robots (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: %(default)s)")
    arguments = parser.parse_args()
    found: dict[int, list[Found]] = {}
    for number, case in results_of(found_in, range(arguments.cases), arguments.jobs):
        found[number] = case
        print(f"{len(found)} of {arguments.cases}", end="\r", file=sys.stderr, flush=True)
    cases = [found[number] for number in sorted(found)]
    print("\n".join(lines_of(cases)))
    by_name = {each[0].name: each for each in zip(*cases, strict=True)}
    within = {"joint3.mass": 0.02, "joint2.coulomb": 0.1, "joint3.coulomb": 0.1}
    is_right = all(abs(case.error) <= most for name, most in within.items() for case in by_name[name])
    return 0 if is_right and all(sum(c.holds for c in each) >= 0.9 * len(each) for each in by_name.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
