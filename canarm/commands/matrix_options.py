"""Options of `canarm fault matrix` for the scenarios of its cells, and what they become."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock

from ..draws import SEED
from ..number_checks import not_negative
from ..options import CellOptions, Truth, whole_number
from ..usage import DEFAULT_LAW, UsageError, parse_settings

if TYPE_CHECKING:
    from ..matrix.plan import Scenario

LATEST_S = 600.0
"""Latest onset: a run keeps every cycle until then."""
MOST_DRAWS = 10_000


def _an_onset(type_: object, value: float | None) -> None:
    if value is not None and not (math.isfinite(value) and 0.0 < value <= LATEST_S):
        raise ValueError(f"must be a number of seconds above 0 and at most {LATEST_S:g} s.")


def _some(type_: object, value: int | None) -> None:
    if value is not None and not 1 <= value <= MOST_DRAWS:
        raise ValueError(f"must be 1 to {MOST_DRAWS}.")


@Parameter(name="*")
@dataclass(frozen=True)
class ScenarioOptions:
    """One scenario, one per seed, or draws; None is the default, or drawn."""

    law: Annotated[
        str | None,
        Parameter(
            metavar="NAME|FILE.py:CLASS",
            help=f"Control law, as of canarm demo; {DEFAULT_LAW} unless given or drawn.",
        ),
    ] = None
    trajectory: Annotated[
        str | None,
        Parameter(
            metavar="NAME|FILE", help="Trajectory, as of canarm demo; the usual one of the cell unless given or drawn."
        ),
    ] = None
    seed: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            validator=not_negative,
            metavar="NUMBER",
            help="Seed of the sensor noise; 0 unless given or drawn.",
        ),
    ] = None
    at: Annotated[
        float | None,
        Parameter(
            metavar="SECONDS",
            validator=_an_onset,
            help="When the fault begins, from the first SYNC; 2.8 s unless given or drawn.",
        ),
    ] = None
    truth: Truth | None = None
    seeds: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            validator=_some,
            metavar="NUMBER",
            help="Run each cell with so many seeds, --seed the first.",
        ),
    ] = None
    draws: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            validator=_some,
            metavar="NUMBER",
            help="Run each cell at so many combinations of onset, seed, law, motion, payload, friction and drive wire: "
            "a Latin hypercube. What is given (--at, --seed, --law, --trajectory, --truth) is not drawn.",
        ),
    ] = None
    draw_seed: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            validator=not_negative,
            metavar="NUMBER",
            help="Of --draws: the same draws for the same number; 0 unless given.",
        ),
    ] = None

    def scenarios(self, cell: CellOptions, nominal: Cell, is_ours: bool) -> "tuple[tuple[Scenario, ...], str]":
        """Every scenario, and a line that describes them, empty for a single one. Raises `CanarmError` for bad options.

        Law and motion are drawn only for our own controller.
        """
        from canarm_controller.reference.trajectory import usual_motion
        from canarm_emulator.robot.truth import Truth as TrueRobot

        from ..matrix import scenarios as kinds
        from ..matrix.plan import Scenario
        from ..session import make_controller, tick_count

        if self.seeds is not None and self.draws is not None:
            raise UsageError("--seeds and --draws: give one of them; --draws draws seeds as well")
        if self.draw_seed is not None and self.draws is None:
            raise UsageError("--draw-seed: is for --draws N")
        usual = Scenario()
        truth = parse_settings("--truth", self.truth or ())
        base = Scenario(
            cell.cell,
            tuple(parse_settings("--set", cell.settings).items()),
            usual.law if self.law is None else self.law,
            usual_motion(nominal) if self.trajectory is None else self.trajectory,
            usual.seed if self.seed is None else self.seed,
            tuple(truth.items()),
            usual.at_s if self.at is None else self.at,
        )
        tick_count(nominal, base.at_s, "--at")
        TrueRobot.from_settings(nominal, truth)
        make_controller(nominal, base.law, base.trajectory, None, Clock.SYNC)
        if self.seeds is not None:
            return kinds.one_a_seed(base, self.seeds), f"law {base.law}, {base.trajectory}, {self.seeds} seeds"
        if self.draws is None:
            return (base,), ""
        given = (
            (kinds.LAW.name, self.law),
            (kinds.MOTION, self.trajectory),
            (SEED.name, self.seed),
            (kinds.ONSET.name, self.at),
        )
        fixed = {name for name, value in given if value is not None}
        if not is_ours:
            fixed |= {kinds.LAW.name, kinds.MOTION}
        number = self.draw_seed or 0
        drawn = kinds.drawn(base, nominal, self.draws, number, fixed)
        for scenario in drawn:
            TrueRobot.from_settings(nominal, dict(scenario.truth))
        return drawn, f"{self.draws} draws, draw seed {number}"
