"""Runs the whole matrix on one or all cores. The results depend neither on their number nor on the order of runs."""

import contextlib
import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

from canarm_protocol.cell.model import Cell

from ..workers.forking import CAN_FORK, in_copy
from ..workers.pool import results_of
from .bus_reactions import beside_twin, is_same
from .evidence import Evidence
from .foreign_run import FIRST_SYNC_S, require_whole, run_foreign
from .judgement import judge
from .naming import is_named_right, part_of
from .plan import MatrixCell, Scenario
from .rig_run import AtOnset, false_alarms, run_in_rig
from .scenarios import command_of, fault_free_command
from .table import FalseAlarm, Matrix, Row

FAULT_FREE_RUNS = 20
PAYLOAD_FACTORS = (1.0, 0.5, 1.5, 0.75, 1.25)
"""Mass of the last link in the fault-free runs, as a multiple of what the controller thinks; used in turn."""
FIRST_ALARM_SEED = 1
OnProgress = Callable[[int, int], None]
OnNote = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Campaign:
    """What is to be run: every one of `cells` in every one of `scenarios`, the draws.

    `controller` is the command of a controller that is not ours; None: ours, in a rig. Of that the fault-free twin of
    each scenario is looked at for false alarms, and `fault_free_runs` more runs. `about` is what the scenarios are.
    """

    scenarios: tuple[Scenario, ...]
    cells: tuple[MatrixCell, ...]
    controller: str | None = None
    fault_free_runs: int = FAULT_FREE_RUNS
    about: str = ""

    @property
    def title(self) -> str:
        """Its title, in one line."""
        first = self.scenarios[0]
        who = f"law {first.law}, {first.trajectory}" if self.controller is None else self.controller
        return f"{first.cell}, {self.about or f'{who}, seed {first.seed}'}"

    @property
    def runs(self) -> tuple[int, int]:
        """How many runs with a fault, and how many without to look for false alarms: none of a strange controller."""
        without = 0 if self.controller is not None else len(self.scenarios) + self.fault_free_runs
        return len(self.cells) * len(self.scenarios), without


@dataclass(frozen=True, slots=True)
class _Task:
    """One run: of a fault, or without any where `fault` is None.

    `draw` counts the scenarios from 1. `number` is that of a fault-free run; None: the twin of the draw. `twin` is that
    of a strange controller.
    """

    scenario: Scenario
    draw: int
    fault: MatrixCell | None
    controller: str | None = None
    twin: Evidence | None = None
    number: int | None = None


_Result = Row | tuple[FalseAlarm, ...]


def run_campaign(
    campaign: Campaign, jobs: int = 1, on_progress: OnProgress | None = None, on_note: OnNote | None = None
) -> Matrix:
    """Run all of it with `jobs` processes; `on_progress(done, all)` is told at the beginning and after every run.

    `on_note` is told what takes long before that. An interrupt ends all that runs; the matrix is then partial. Raises
    what a strange controller's twin raises, and `UsageError` for one that ends by itself too early. What else goes
    wrong in a run is in its row.
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
    alarms = [each for each in in_order if isinstance(each, tuple)]
    every_alarm = tuple(alarm for each in alarms for alarm in each)
    places = {cell.name: place for place, cell in enumerate(campaign.cells)}
    rows = sorted((each for each in in_order if isinstance(each, Row)), key=lambda row: (places[row.name], row.draw))
    return Matrix(campaign.title, tuple(rows), len(alarms), every_alarm, runs_left=total - len(results))


def _tasks(campaign: Campaign, note: OnNote) -> list[_Task]:
    """Draw by draw, those with the wire model last: a process has the beginnings of few kinds of run at hand."""
    command, tasks = campaign.controller, []
    cells = sorted(campaign.cells, key=lambda cell: cell.needs_wire)
    for draw, scenario in enumerate(campaign.scenarios, start=1):
        if command is None:
            tasks.append(_Task(scenario, draw, None))
            tasks += [_Task(scenario, draw, cell) for cell in cells]
        else:
            twins = _foreign_twins(scenario, {cell.needs_wire for cell in cells}, command, note)
            tasks += [_Task(scenario, draw, cell, command, twins[cell.needs_wire]) for cell in cells]
    if command is None:
        turns = zip(range(campaign.fault_free_runs), itertools.cycle(enumerate(campaign.scenarios, start=1)))
        tasks += [_Task(scenario, draw, None, number=number) for number, (draw, scenario) in turns]
    return tasks


def _foreign_twins(scenario: Scenario, kinds: set[bool], command: str, note: OnNote) -> dict[bool, Evidence]:
    twins, cell = {}, _load(scenario)
    for with_wire in sorted(kinds):
        how = ", with the wire model" if with_wire else ""
        note(f"first a run without any fault{how}; the first SYNC has to come within {FIRST_SYNC_S:g} s")
        twins[with_wire] = run_foreign(scenario, cell, None, command, with_wire)
        require_whole(twins[with_wire], scenario, cell, command)
    return twins


def _run(task: _Task) -> _Result:
    try:
        return _alarms(task) if task.fault is None else _row(task, task.fault)
    except Exception as error:
        return _lost(task, error)


def _lost(task: _Task, error: Exception) -> _Result:
    """What stands for a run that comes to nothing: a cell that is broken, or a run that proves nothing."""
    if task.fault is None:
        name = fault_free_command(task.scenario) if task.number is None else _varied(task.scenario, task.number)[0]
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return (FalseAlarm(name, "run lost", text, 0),)
    return _labelled(task, Row.broken(task.fault, error), task.fault)


def _row(task: _Task, fault: MatrixCell) -> Row:
    cell = _load(task.scenario)
    if task.controller is not None:
        assert task.twin is not None, "the task of a strange controller brings its twin"
        run = run_foreign(task.scenario, cell, fault, task.controller, fault.needs_wire)
        return _labelled(task, _judged(cell, fault, beside_twin(run, task.twin), task.twin), fault)
    if not CAN_FORK:
        run, twin = run_in_rig(task.scenario, cell, fault), _twin(task.scenario, fault.needs_wire)
        return _labelled(task, _judged(cell, fault, _answering(run, twin), twin, is_ours=True), fault)
    onset, twin = _onset(task.scenario, fault.needs_wire), _twin(task.scenario, fault.needs_wire)

    def go_on() -> Row:
        try:
            return _judged(cell, fault, _answering(onset.observe(fault), twin), twin, is_ours=True)
        except Exception as error:
            return Row.broken(fault, error)

    return _labelled(task, in_copy(go_on), fault)


def _judged(cell: Cell, fault: MatrixCell, run: Evidence, twin: Evidence, is_ours: bool = False) -> Row:
    found = judge(cell, run, twin, fault.is_dangerous, fault.may_mislead, fault.lets_go)
    named = is_named_right(cell, fault, found.first) if is_ours and found.first is not None else None
    return Row.of(fault, found, named)


def _labelled(task: _Task, row: Row, fault: MatrixCell) -> Row:
    """The row with what does not depend on the run: which part has failed, which draw it is, how to run it again."""
    part = part_of(_load(task.scenario), fault)
    repeat = command_of(task.scenario, fault, task.controller)
    return replace(row, part=part.value if part else "", draw=task.draw, repeat=repeat)


def _answering(run: Evidence, twin: Evidence) -> Evidence:
    """The run without what the twin notices as well, then and there: a false alarm is no answer to the fault."""
    notices = tuple(each for each in run.notices if not any(is_same(each, its) for its in twin.notices))
    return replace(run, notices=notices)


def _alarms(task: _Task) -> tuple[FalseAlarm, ...]:
    """What is noticed without a fault."""
    scenario, number = task.scenario, task.number
    if number is None:
        name, notices = fault_free_command(scenario), _twin(scenario, False).notices
    else:
        name, factor, seed = _varied(scenario, number)
        notices = false_alarms(replace(scenario, seed=seed), _load(scenario), factor)
    return tuple(FalseAlarm(name, each.detector, each.where, each.cycle) for each in notices)


def _varied(scenario: Scenario, number: int) -> tuple[str, float, int]:
    """Name, payload factor and seed of a run without a fault that is nobody's twin."""
    factor, seed = PAYLOAD_FACTORS[number % len(PAYLOAD_FACTORS)], scenario.seed + FIRST_ALARM_SEED + number
    return f"seed {seed}, payload x {factor:g}", factor, seed


@functools.lru_cache(maxsize=2)
def _load(scenario: Scenario) -> Cell:
    return scenario.load()


@functools.lru_cache(maxsize=2)
def _onset(scenario: Scenario, with_wire: bool) -> AtOnset:
    """The beginning that all runs of a scenario share; once per process, which must not let it go on."""
    return AtOnset(scenario, _load(scenario), with_wire)


@functools.lru_cache(maxsize=2)
def _twin(scenario: Scenario, with_wire: bool) -> Evidence:
    """The fault-free run of our own controller; run once per process."""
    if not CAN_FORK:
        return run_in_rig(scenario, _load(scenario), None, with_wire)
    onset = _onset(scenario, with_wire)
    return in_copy(lambda: onset.observe(None))
