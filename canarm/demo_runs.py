"""The runs of a demo, one after the other: the first as on the command line, further ones as its user asks for them."""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cyclopts import Token

from canarm_controller.laws import LAWS
from canarm_controller.reference.trajectory import named_motions
from canarm_protocol.clock import Clock
from canarm_protocol.errors import CanarmError
from canarm_protocol.runs.run_folder import create_run_folder, new_run_folder
from canarm_protocol.runs.tentative import Tentative

from .demo_run import DemoPlan, DemoRun, tell
from .number_checks import possible_seed
from .options import SLOWEST_PACE, multiple_or_max, pace_text, whole_number
from .session import make_controller
from .usage import UsageError

if TYPE_CHECKING:
    from canarm_tui.run_again import NextRun

MOST_RUNS = 1000


class _Where(Mapping[str, Any]):
    """Host and port of the buses of the present run, which are others for each."""

    def __init__(self, runs: "DemoRuns") -> None:
        self._runs = runs

    def _now(self) -> dict[str, Any]:
        run = self._runs.run
        return {"host": run.plan.host, "port": run.port}

    def __getitem__(self, key: str) -> Any:
        return self._now()[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._now())

    def __len__(self) -> int:
        return len(self._now())


class DemoRuns:
    """The present run, and those that are over. `out` is the folder that was asked for; further runs get one in it."""

    ends_here = True
    """The demo ends with its dashboard."""

    def __init__(self, plan: DemoPlan, out: Path | None, with_dashboard: bool) -> None:
        self._out, self._with_dashboard = out, with_dashboard
        self._over: list[DemoRun] = []
        self.number = 1
        """Which run it is."""
        self.run = self._made(plan)
        self.where: Mapping[str, Any] = _Where(self)
        """Host and port of the buses, as options of a bus; it follows the present run."""

    @property
    def last(self) -> "NextRun":
        """The present run, as on the command line."""
        from canarm_tui.run_again import NextRun

        plan = self.run.plan
        pace = "" if plan.pace is None else pace_text(plan.pace)
        return NextRun(plan.control.law, plan.control.motion(plan.cell), str(plan.seed), pace)

    @property
    def hints(self) -> "NextRun":
        """What a further run may be."""
        from canarm_tui.run_again import NextRun

        return NextRun(
            law=f"{', '.join(LAWS)}, or FILE.py:CLASS",
            trajectory=f"{', '.join(named_motions(self.run.plan.cell))}, or a file",
            seed="of the sensor noise",
            pace="times real time, or max" if self.run.plan.clock == "sync" else "empty: the wall clock has one",
        )

    @property
    def folder(self) -> str:
        """Where the present run is recorded."""
        return str(self.run.folder)

    def start(self, wanted: "NextRun") -> str:
        """Begin another run; raises `CanarmError` if it cannot be, and then the last one is still the present one."""
        run = self._made(self._planned(wanted))
        self.run.close()
        try:
            run.start(is_another=True)
        except BaseException:
            run.close()
            raise
        self._over.append(self.run)
        self.run = run
        self.number += 1
        return f"running again: {wanted.law} on {wanted.trajectory}, recorded in {run.folder}"

    def close(self) -> None:
        """End all processes."""
        self.run.close()

    def report(self, as_json: bool, say: Callable[[str], None]) -> int:
        """Say the summary of each run; the exit status is that of the last one. Raises `BusError` or `UsageError`."""
        for run in self._over:
            try:
                run.report(as_json, say)
            except CanarmError as error:
                tell(str(error))
        return self.run.report(as_json, say)

    def _made(self, plan: DemoPlan) -> DemoRun:
        made = Tentative()
        if self._out is None:
            folder = new_run_folder(made=made)
        elif not self._over and not hasattr(self, "run"):
            folder = create_run_folder(self._out, made=made)
        else:
            names = (self._out / f"run-{number}" for number in range(2, MOST_RUNS))
            folder = create_run_folder(next(each for each in names if not each.exists()), made=made)
        return DemoRun(plan, folder, made, self._with_dashboard)

    def _planned(self, wanted: "NextRun") -> DemoPlan:
        plan = self.run.plan
        control = replace(plan.control, law=wanted.law, trajectory=wanted.trajectory)
        with contextlib.chdir(Path.cwd()):
            built = make_controller(
                plan.cell, control.law, control.motion(plan.cell), control.feedforward, Clock[plan.clock.upper()]
            )
        seed = _number("seed", wanted.seed, whole_number)
        try:
            possible_seed(int, seed)
        except ValueError as error:
            raise UsageError(f"seed {wanted.seed}: {error}") from None
        pace = None
        if plan.clock == "sync":
            pace = _number("pace", wanted.pace, multiple_or_max("real time", SLOWEST_PACE))
        return replace(plan, control=control, feedforward=built.loop.feedforward_kind, seed=seed, pace=pace)


def _number(name: str, text: str, convert: Callable[[object, list[Token]], Any]) -> Any:
    try:
        return convert(object, [Token(value=text)])
    except ValueError as error:
        raise UsageError(f"{name} {text!r}: {error}") from None
