"""The scenarios of a campaign: one, one per seed, or draws from a box; and the command that repeats one of them.

Owns the campaign's box; `canarm.draws` turns a draw into a robot.
"""

import glob
import shlex
from collections.abc import Collection
from dataclasses import replace

from canarm_controller.laws.loading import LAWS
from canarm_controller.reference.trajectory import built_in_motions
from canarm_protocol.cell.model import Cell

from ..draws import JOINT_BOX, PAYLOAD, SEED, Axis, Choice, Span, hypercube, truth_of
from .plan import INJECTED_S, OBSERVED_S, MatrixCell, Scenario

ONSET = Span("onset", 2.0, 8.0, "s")
"""More than two periods of either joint of konkuk1's sine, after the motion has blended in."""
LAW = Choice("law", tuple(LAWS))
MOTION = "motion"
OF_A_JOINT = ("wire", "wire_stiffness", "coulomb", "viscous")
"""The axes of a robot's box that are drawn for each joint. Whatever a sensor could be blamed for stays nominal."""

DEFINITION = (
    "draw",
    "A scenario that all cells run in: onset, seed, law, motion and true robot, from a Latin hypercube. Of a cell with "
    "several draws the worst is shown.",
)


def campaign_box(cell: Cell) -> list[Axis]:
    """The box from which a campaign draws."""
    axes: list[Axis] = [ONSET, SEED, LAW, Choice(MOTION, built_in_motions(cell)), PAYLOAD]
    for name in cell.joint_names:
        axes += [replace(axis, name=f"{name}.{axis.name}") for axis in JOINT_BOX if axis.name in OF_A_JOINT]
    return axes


def one_a_seed(base: Scenario, count: int) -> tuple[Scenario, ...]:
    """`base` with `count` seeds, from its own on."""
    return tuple(replace(base, seed=base.seed + number) for number in range(count))


def drawn(base: Scenario, cell: Cell, count: int, draw_seed: int, fixed: Collection[str] = ()) -> tuple[Scenario, ...]:
    """`count` scenarios from the box. An onset is a whole number of cycles.

    The axes whose names are `fixed`, and keys of the truth that `base` names, are as in `base`.
    """
    scenarios = []
    for draw in hypercube(campaign_box(cell), count, draw_seed):
        changed: dict[str, object] = {}
        if ONSET.name not in fixed:
            changed["at_s"] = round(float(draw[ONSET.name]) / cell.bus.cycle_s) * cell.bus.cycle_us / 1e6
        for name, field in ((SEED.name, "seed"), (LAW.name, "law"), (MOTION, "trajectory")):
            if name not in fixed:
                changed[field] = draw[name]
        truth = truth_of(cell, draw) | dict(base.truth)
        scenarios.append(replace(base, truth=tuple(truth.items()), **changed))  # type: ignore[arg-type]
    return tuple(scenarios)


def command_of(scenario: Scenario, fault: MatrixCell | None, controller: str | None = None) -> str:
    """The command line that runs `fault` (None: all faults) in `scenario`."""
    words = ["canarm", "fault", "matrix"]
    if fault is not None:
        words += ["--only", glob.escape(fault.name)]
    if scenario.at_s != INJECTED_S:
        words += ["--at", _seconds(scenario.at_s)]
    words += _options(scenario)
    if controller is not None:
        words += ["--controller", controller]
    return shlex.join(words)


def fault_free_command(scenario: Scenario) -> str:
    """The command line that runs `scenario` without a fault, for as long as it is observed."""
    seconds = _seconds(scenario.at_s + OBSERVED_S)
    return shlex.join(["canarm", "demo", "--no-tui", "--pace", "max", "--seconds", seconds, *_options(scenario)])


def _options(scenario: Scenario) -> list[str]:
    """The options in which the scenario differs from the default."""
    words, usual = [], Scenario()
    for option, value, otherwise in (
        ("--cell", scenario.cell, usual.cell),
        ("--seed", str(scenario.seed), str(usual.seed)),
        ("--law", scenario.law, usual.law),
        ("--trajectory", scenario.trajectory, usual.trajectory),
    ):
        if value != otherwise:
            words += [option, value]
    for option, pairs in (("--set", scenario.settings), ("--truth", scenario.truth)):
        for key, value in pairs:
            words += [option, f"{key}={value}"]
    return words


def _seconds(value: float) -> str:
    return f"{value:.9g}"
