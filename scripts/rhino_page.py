"""The page docs/rhino.md: text and tables around what `rhino_figures` found. No figure is written by hand."""

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from rhino_figures import RANDOM_POSES, Results
from rhino_findings import Finding, arrangement_text, as_printed, by_grasp, continuity, energy, motion, percent
from rhino_pictures import JOINTS_PICTURE, MAP_PICTURE

from canarm.cooperation import PlanChecks, Reason

PAGE = """\
# Two RHINO robots carry one object: the paper's result, side by side

Lee, Suh, Suh and Kim (1986) let a master robot lead a long object along a path and a slave robot support it, both
with five axes, and simulate it on a circle of 0.5 inch. This page is written by `make rhino`, from
`canarm.cooperation`; no figure in it is written by hand, and the command ends with an error when a sentence below no
longer fits the figures. It is kinematics, and at the end what they cost; no bus, and nothing moves. [What is wrong in
print](cooperation-errata.md) has a page of its own.

The worked case: two RHINO XR; the master starts at [0, −80, 90, −10, 90]°, the object lies along its tool's x axis,
the slave holds it 0.3 m further on, and its base stands at (−0.28, −0.30, 0) m in the master's, with the same
heading. The circle has a radius of 0.5 inch, 12.7 mm, in the master's Y–Z plane.

## Fig. 6 redrawn

![All ten joint angles over a lap](pictures/{joints_picture})

The paper's Fig. 6 shows these ten angles without a scale that has come down to us. The master's roll rests: (5) never
turns it.

{lap}

## The steps as printed, against the exact ones

As printed, STEPs 1 to 3 lay the slave's hand along the object's o axis, whatever the slave's base is. Five axes can
point there only where that axis happens to lie in the plane through the slave's base's axis and B; elsewhere a yaw is
left. Below, the master's roll is changed and the object turned in its tool so that it stays where it is: nothing
changes for the object, and nothing for the exact steps. The last three columns are what an arm does that is driven
there by the closed form, which passes over the yaw.

{printed}

Here a_o points nearly straight down, and so lies in the slave's plane wherever its base is: projected into that
plane, the hand stays across a_o whatever the yaw was. Elsewhere it does not. Of {random_count} random poses of the
master, tip above the floor, σ_min above 0.03 m/rad, with the slave's base at random within 1 m of the master's, these
are the ones where the exact steps have a solution:

{random}

## "A solution always exists"

It does not, of the exact steps either. The same random poses, by what the exact steps say:

{shares}

And for the paper's own circle, the slave's base anywhere on the map below ({squares} squares of 25 mm): {works} work.

![Where the slave's base may stand](pictures/{map_picture})

{reasons}

The map knows no obstacles: bases that would stand in the master work on paper.

## "Continuous values"

{continuous}

## How much the slave moves

The authors leave open that the slave may have to move much for a small motion of the master. Measured by the length
of the joint paths, Σ‖Δθ‖, over the circle:

{travel}

{findings}

## What it costs

With the masses, gears and friction of the cell `rhino-pair`, which are assumed where no source has them, at 5 s a
lap: what the motors do (braking is not given back), and what heats their windings. The slave carries half of the
object.

{cost}

{energy}
"""


def page(results: Results) -> str:
    """The page, Markdown."""
    return PAGE.format(
        joints_picture=JOINTS_PICTURE,
        map_picture=MAP_PICTURE,
        lap=_lap(results),
        printed=_printed(results),
        random_count=f"{RANDOM_POSES:,}".replace(",", " "),
        random=f"{_random(results)}\n\n{_filled(as_printed(results).text)}",
        shares=_shares("of the random poses", results.random.shares),
        squares=results.map.reason.size,
        works=percent(results.map.shares()[Reason.NONE]),
        reasons=_shares("on the map", results.map.shares()),
        continuous=_filled(continuity(results).text),
        travel=_travel(results),
        findings=_listed(motion(results)),
        cost=_cost(results),
        energy=_listed(energy(results)),
    )


def misfits(results: Results) -> list[Finding]:
    """Findings that the figures do not bear out: their words in `rhino_findings` are to be written again."""
    return [
        each
        for each in (as_printed(results), continuity(results), *motion(results), *energy(results))
        if not each.holds
    ]


def _lap(results: Results) -> str:
    checks, paper = results.lap.checks(), results.paper
    slave = ", ".join(f"{angle:.2f}" for angle in np.degrees(results.lap.slave_rad[0]))
    return _table(
        ["figure", "value"],
        [
            ("slave's joints at the start", f"[{slave}]°"),
            ("largest step of a joint, 360 poses a lap: master, slave", _pair(paper)),
            ("the same at 400 Hz, 5 s a lap", _pair(checks)),
            ("the master's tip from the circle, (5) as printed, 360 poses", f"{paper.path_error_m:.1e} m"),
            ("the same with Newton's steps after (5)", _below(checks.path_error_m, 1e-15, "m")),
            ("grasp distance from 0.3 m", _below(checks.grasp_error_m, 1e-15, "m")),
            (
                "Definition 1, put right: a_s·a_o, n_s − a_o",
                _below(max(checks.perpendicular_error, checks.normal_error), 1e-14, ""),
            ),
            ("least σ_min of the master's Jacobian", f"{checks.least_singular_value_m:.3f} m/rad"),
            ("the master's joints after a lap, from where they began", f"up to {results.drift_deg:.4f}°"),
        ],
    )


def _printed(results: Results) -> str:
    head = ["master's roll", "yaw left, degrees", "hand misses by", "a_s from ⟂ a_o", "n_s from a_o"]
    return _table(
        head,
        [
            (
                f"{roll:g}°",
                f"{each.least_yaw_deg:.2f} to {each.greatest_yaw_deg:.2f}",
                f"{each.hand_deg:.2f}°",
                f"{each.across_deg:.3f}°",
                f"{each.normal_deg:.3f}°",
            )
            for roll, each in results.printed.items()
        ],
    )


def _random(results: Results) -> str:
    random = results.random
    rows = [
        (name, *(f"{value:.1f}°" for value in np.percentile(angles, (10, 50, 90))))
        for name, angles in (
            ("yaw left by the printed steps", random.yaw_deg),
            ("driven there: a_s from ⟂ a_o", random.across_deg),
            ("driven there: n_s from a_o", random.normal_deg),
        )
    ]
    return _table(["of these poses", "10 % below", "half below", "90 % below"], rows)


def _travel(results: Results) -> str:
    best, worst = results.arrangements[0], results.worst
    master, slave = np.degrees(results.lap.travel_rad)
    ratios = results.map.travel_ratio[np.isfinite(results.map.travel_ratio)]
    rows = [
        ("worked case", f"{results.lap.travel_ratio:.2f}", f"master {master:.1f}°, slave {slave:.1f}°"),
        ("half of the bases on the map that work, at most", f"{np.median(ratios):.2f}", ""),
        ("nine tenths of them, at most", f"{np.percentile(ratios, 90):.2f}", ""),
        (
            "the worst of them",
            f"{ratios.max():.1f}",
            f"base ({worst.x_m:.3f}, {worst.y_m:.3f}) m: B comes to {worst.axis_distance_m:.2f} m from its axis, "
            f"sin θ3 to {worst.elbow_sine:.2f}, the crossing to {worst.crossing:.2f}",
        ),
        ("the least, base at least 0.3 m beside the master's", f"{best.travel_ratio:.2f}", arrangement_text(best)),
    ]
    for distance, least in by_grasp(results).items():
        ratio = f"{least.travel_ratio:.2f}"
        rows.append((f"the least with a grasp distance of {distance:g} m", ratio, arrangement_text(least)))
    return _table(["", "slave's path over the master's", ""], rows)


def _cost(results: Results) -> str:
    cheapest = min(range(len(results.costs)), key=lambda place: results.costs[place].slave.work_j)
    rows = [("worked case", results.cost), ("the worst base on the map", results.worst_cost)]
    rows += [
        (f"least motion: {arrangement_text(results.arrangements[0])}", results.costs[0]),
        (f"least work: {arrangement_text(results.arrangements[cheapest])}", results.costs[cheapest]),
    ]
    head = ["", "work: master", "slave", "heat: master", "slave", "slave's step over the master's"]
    return _table(
        head,
        [
            (
                name,
                f"{each.master.work_j:.2f} J",
                f"{each.slave.work_j:.2f} J",
                f"{each.master.heat_j:.1f} J",
                f"{each.slave.heat_j:.1f} J",
                f"{each.least_ratio:.2f} to {each.greatest_ratio:.2f}",
            )
            for name, each in rows
        ],
    )


def _pair(checks: PlanChecks) -> str:
    return f"{math.degrees(checks.master_step_rad):.4f}°, {math.degrees(checks.slave_step_rad):.4f}°"


def _below(value: float, limit: float, unit: str) -> str:
    return f"below {limit:g} {unit}".strip() if value < limit else f"{value:.1e} {unit}".strip()


def _shares(of: str, shares: Mapping[Reason, float]) -> str:
    return _table([of, "share"], [(reason.words, percent(part)) for reason, part in shares.items()])


def _listed(findings: Iterable[Finding]) -> str:
    return "\n".join(_filled(f"- {finding.text}", "  ") for finding in findings)


def _filled(text: str, indent: str = "") -> str:
    return textwrap.fill(text, 120, subsequent_indent=indent, break_on_hyphens=False)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(head)} |", f"|---|{'---|' * (len(head) - 1)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])
