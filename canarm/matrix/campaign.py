"""Runs the whole matrix, on one core or on all. The results do not depend on how many there are, nor on their order."""

import contextlib
import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

from canarm_protocol.cell.model import Cell

from .bus_reactions import beside_twin
from .evidence import Evidence
from .foreign_run import FIRST_SYNC_S, require_whole, run_foreign
from .judgement import judge
from .plan import MatrixCell, Scenario
from .pool import LostWorkerError, results_of
from .rig_run import false_alarms, run_in_rig
from .table import FalseAlarm, Matrix, Row

FAULT_FREE_RUNS = 20
PAYLOAD_FACTORS = (1.0, 0.5, 1.5, 0.75, 1.25)
"""What the last link weighs in the fault-free runs, as a multiple of what the controller thinks; in turns."""
FIRST_ALARM_SEED = 1
OnProgress = Callable[[int, int], None]
OnNote = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Campaign:
    """What is to be run. `controller` is the command of a controller that is not ours; None: ours, in a rig."""

    scenario: Scenario
    cells: tuple[MatrixCell, ...]
    controller: str | None = None
    fault_free_runs: int = FAULT_FREE_RUNS

    @property
    def title(self) -> str:
        """What it is about, in a line."""
        scenario = self.scenario
        who = self.controller if self.controller is not None else f"law {scenario.law}, {scenario.trajectory}"
        return f"{scenario.cell}, {who}, seed {scenario.seed}"

    @property
    def runs(self) -> tuple[int, int]:
        """How many runs with a fault, and how many without to look for false alarms: none of a strange controller."""
        return len(self.cells), 0 if self.controller is not None else self.fault_free_runs


@dataclass(frozen=True, slots=True)
class _Task:
    """One run: of a fault, or without any where `fault` is None. `twin` is that of a strange controller."""

    scenario: Scenario
    fault: MatrixCell | None
    controller: str | None = None
    twin: Evidence | None = None
    number: int = 0


_Result = Row | tuple[FalseAlarm, ...]


def run_campaign(
    campaign: Campaign, jobs: int = 1, on_progress: OnProgress | None = None, on_note: OnNote | None = None
) -> Matrix:
    """Run all of it with `jobs` processes; `on_progress(done, all)` is told at the beginning and after every run.

    `on_note` is told what takes long before that. An interrupt ends all that runs; the matrix is then partial. Raises
    what the twin's run raises, and `UsageError` for a strange controller that ends by itself too early. What goes wrong
    in the run of a fault is in its row.
    """
    results: dict[int, _Result] = {}
    total = sum(campaign.runs)
    with contextlib.suppress(KeyboardInterrupt):
        tasks = _tasks(campaign, on_note or (lambda text: None))
        tell = on_progress or (lambda done, total: None)
        tell(0, total)
        with contextlib.closing(results_of(_run, tasks, jobs, _lost)) as coming:
            for place, result in coming:
                results[place] = result
                tell(len(results), total)
    in_order = [results[place] for place in sorted(results)]
    rows = tuple(each for each in in_order if isinstance(each, Row))
    alarms = [each for each in in_order if isinstance(each, tuple)]
    every_alarm = tuple(alarm for each in alarms for alarm in each)
    return Matrix(campaign.title, rows, len(alarms), every_alarm, runs_left=total - len(results))


def _tasks(campaign: Campaign, note: OnNote) -> list[_Task]:
    scenario, command = campaign.scenario, campaign.controller
    if command is None:
        tasks = [_Task(scenario, cell) for cell in campaign.cells]
        return tasks + [_Task(scenario, None, number=number) for number in range(campaign.fault_free_runs)]
    twins = {}
    for with_wire in sorted({cell.needs_wire for cell in campaign.cells}):
        how = ", with the wire model" if with_wire else ""
        note(f"first a run without any fault{how}; the first SYNC has to come within {FIRST_SYNC_S:g} s")
        twins[with_wire] = run_foreign(scenario, _load(scenario), None, command, with_wire)
        require_whole(twins[with_wire], _load(scenario), command)
    return [_Task(scenario, cell, command, twins[cell.needs_wire]) for cell in campaign.cells]


def _run(task: _Task) -> _Result:
    cell, fault = _load(task.scenario), task.fault
    if fault is None:
        return _fault_free(task.scenario, cell, task.number)
    twin = task.twin or _twin(task.scenario, fault.needs_wire)
    try:
        run = _evidence(task, cell, fault, twin)
        return Row.of(fault, judge(cell, run, twin, fault.is_dangerous, fault.may_mislead))
    except Exception as error:
        return Row.broken(fault, error)


def _lost(task: _Task, error: LostWorkerError) -> _Result:
    """What stands for a run that ends its process each time: a cell that is broken, or a run that proves nothing."""
    if task.fault is None:
        return (FalseAlarm(_fault_free_run(task.scenario, task.number)[0], "run lost", str(error), 0),)
    return Row.broken(task.fault, error)


def _evidence(task: _Task, cell: Cell, fault: MatrixCell, twin: Evidence) -> Evidence:
    if task.controller is None:
        return run_in_rig(task.scenario, cell, fault, fault.needs_wire)
    return beside_twin(run_foreign(task.scenario, cell, fault, task.controller, fault.needs_wire), twin)


def _fault_free(scenario: Scenario, cell: Cell, number: int) -> tuple[FalseAlarm, ...]:
    name, factor, seed = _fault_free_run(scenario, number)
    notices = false_alarms(replace(scenario, seed=seed), cell, factor)
    return tuple(FalseAlarm(name, each.detector, each.where, each.cycle) for each in notices)


def _fault_free_run(scenario: Scenario, number: int) -> tuple[str, float, int]:
    """Name, payload factor and seed of a run without a fault."""
    factor, seed = PAYLOAD_FACTORS[number % len(PAYLOAD_FACTORS)], scenario.seed + FIRST_ALARM_SEED + number
    return f"seed {seed}, payload x {factor:g}", factor, seed


@functools.lru_cache(maxsize=2)
def _load(scenario: Scenario) -> Cell:
    return scenario.load()


@functools.lru_cache(maxsize=4)
def _twin(scenario: Scenario, with_wire: bool) -> Evidence:
    """The fault-free run of our own controller; once per process."""
    return run_in_rig(scenario, _load(scenario), None, with_wire)
