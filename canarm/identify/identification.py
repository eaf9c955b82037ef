"""Identification of a recorded run: every robot of its cell, as text, as lines for the cell, as plain values."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from canarm_controller.run.recording import SIGNALS_FILE
from canarm_protocol.cell.model import Cell, Robot
from canarm_protocol.shown import printable

from ..runs.run import Run
from ..signal_table import Columns
from ..usage import UsageError
from .estimate import Estimate, Identified, at_least, identify
from .motion import Floats, Motion, disturbed, motion_of
from .physical import UNITS, ArmPrediction, Kind

DISTURBED = 30
"""How often: a standard deviation is then known to 13 %."""
WIDE = 0.2
"""An interval of more than that share of the value, either way, says little."""
ALIKE = 0.95
ILL = 300.0
"""With a condition number above that, intervals of single parameters are wide, though all together predict well."""


@dataclass(frozen=True)
class Identification:
    """What was found for each robot of a run."""

    cell: Cell
    robots: tuple[tuple[Robot, tuple[str, ...], Identified], ...]
    seconds: float

    def lines(self) -> Iterator[str]:
        """For a terminal: what was found, how sure it is, what the motion does not show, and lines for the cell."""
        for robot, names, found in self.robots:
            condition = f"{found.condition:.3g}" if math.isfinite(found.condition) else "infinite"
            yield f"{robot.name}: {self.seconds:.1f} s of motion, condition number {condition}{_judged(found)}"
            yield f"{'':26}{'cell':>12}{'found':>12}{'95 % within':>14}"
            for each in found.estimates:
                yield _line(each)
            left = ", ".join(f"{name} {1e3 * a:.2g}" for name, a in zip(names, found.left_over_a, strict=True))
            yield f"left over of the currents, mA: {left}"
            yield "lines for the cell:"
            yield from _cell_lines(robot, names, found.estimates)

    def as_plain(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "cell": self.cell.name,
            "seconds": self.seconds,
            "robots": [
                {
                    "robot": robot.name,
                    "condition": found.condition if math.isfinite(found.condition) else None,
                    "left_over_a": dict(zip(names, found.left_over_a, strict=True)),
                    "parameters": {each.parameter.name: _plain(each) for each in found.estimates},
                }
                for robot, names, found in self.robots
            ],
        }


def identified(run: Run, free: Sequence[Kind]) -> Identification:
    """Identify the robots of `run`. Raises `CanarmError`: no cell, no table, nothing that moves."""
    cell = run.cell
    if cell.object is not None:
        raise UsageError(f"{cell.name}: its robots carry an object, and what their hands press is not measured")
    where = printable(str(run.path))
    if not run.controller:
        damaged = next((each for each in run.complaints if each.startswith(SIGNALS_FILE)), None)
        why = damaged or f"has no {SIGNALS_FILE}, so nothing is known of what was measured"
        raise UsageError(f"{where}: {why}")
    try:
        motion = motion_of(cell, run.controller)
        found = []
        for robot, own in zip(cell.robot, cell.blocks, strict=True):
            names = cell.joint_names[own]
            arm = ArmPrediction(robot, names, free)
            fit = identify(arm, _part(motion, own))
            found.append((robot, names, at_least(fit, _by_sensors(cell, run.controller, arm, own, fit))))
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from None
    except (np.linalg.LinAlgError, OverflowError):
        raise UsageError(f"{where}: its measurements fit no arm of {cell.name} at all") from None
    return Identification(cell, tuple(found), len(motion.angle_rad) * motion.step_s)


def _by_sensors(cell: Cell, columns: Columns, arm: ArmPrediction, own: slice, fit: Identified) -> Floats:
    """The standard deviation of each value that the noise of the sensors alone makes.

    What they do to the regressor, and slowly to the angles, does not show in what is left over. The run is disturbed
    once more, some times, and identified again.
    """
    chance = np.random.default_rng(0)
    start = np.array([each.value for each in fit.estimates])
    values = []
    for _ in range(DISTURBED):
        motion = _part(motion_of(cell, disturbed(cell, columns, chance)), own)
        values.append([each.value for each in identify(arm, motion, start, 2).estimates])
    return np.asarray(np.std(values, axis=0, ddof=1))


def _part(motion: Motion, own: slice) -> Motion:
    return replace(
        motion,
        angle_rad=motion.angle_rad[:, own],
        speed_rad_s=motion.speed_rad_s[:, own],
        acceleration_rad_s2=motion.acceleration_rad_s2[:, own],
        current_a=motion.current_a[:, own],
        speed_noise_rad_s=motion.speed_noise_rad_s[own],
    )


def _judged(found: Identified) -> str:
    if not all(each.is_seen for each in found.estimates):
        return ": the motion does not show everything; try --trajectory excite"
    return ": some can hardly be told apart" if found.condition > ILL else ""


def _line(each: Estimate) -> str:
    parameter, unit = each.parameter, UNITS[each.parameter.kind]
    head = f"{parameter.name:<26}{parameter.nominal:>12.5g}"
    if not each.is_seen:
        return f"{head}{'-':>12}{'-':>14} {unit}  not excited: stays as in the cell"
    note = ""
    if each.half > WIDE * abs(each.value):
        note = "  hardly excited"
    if each.alike is not None and abs(each.alike[1]) > ALIKE:
        note += f"  hardly told from {each.alike[0]}"
    return f"{head}{each.value:>12.5g}{f'+-{each.half:.2g}':>14} {unit}{note}"


def _plain(each: Estimate) -> dict[str, Any]:
    if not each.is_seen:
        return {"cell": each.parameter.nominal, "found": None, "within": None, "unit": UNITS[each.parameter.kind]}
    found = {"found": float(f"{each.value:.6g}"), "within": float(f"{each.half:.3g}")}
    return {"cell": each.parameter.nominal, **found, "unit": UNITS[each.parameter.kind]}


def _cell_lines(robot: Robot, names: Sequence[str], estimates: Sequence[Estimate]) -> Iterator[str]:
    """TOML, joint by joint: what to put into its tables. What is no surer than its own size is left as it is."""
    for place, (joint, name) in enumerate(zip(robot.joint, names, strict=True)):
        own = [each for each in estimates if each.parameter.place == place]
        mine = {each.parameter.kind: each for each in own if each.is_seen and each.half < each.value}
        if not mine:
            continue
        yield f"# {name}"
        if Kind.MASS in mine or Kind.CENTRE in mine:
            yield f"[robot.joint.{'body' if joint.body else 'link'}]"
        solid = joint.solid
        if (mass := mine.get(Kind.MASS)) is not None:
            factor = mass.value / mass.parameter.nominal
            moments = ", ".join(f"{factor * each:.4g}" for each in solid.inertia_kg_m2)
            yield f"mass_kg = {mass.value:.4g}  # +- {mass.half:.2g}"
            yield f"inertia_kg_m2 = [{moments}]  # as the mass"
            products = getattr(solid, "products_kg_m2", ())
            if any(products):
                yield f"products_kg_m2 = [{', '.join(f'{factor * each:.4g}' for each in products)}]  # as the mass"
        if (centre := mine.get(Kind.CENTRE)) is not None:
            factor = centre.value / centre.parameter.nominal
            places = ", ".join(f"{factor * each:.4g}" for each in solid.centre_of_mass_m)
            yield f"centre_of_mass_m = [{places}]  # +- {centre.half:.2g}"
        keys = {
            Kind.TORQUE_CONSTANT: "torque_constant_nm_a",
            Kind.COULOMB: "coulomb_friction_nm",
            Kind.VISCOUS: "viscous_friction_nm_s",
        }
        if set(mine) & set(keys):
            yield "[robot.joint.motor]"
        for kind, key in keys.items():
            if kind in mine:
                yield f"{key} = {mine[kind].value:.4g}  # +- {mine[kind].half:.2g}"
