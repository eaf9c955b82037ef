"""Runs the whole matrix, on one core or on all. The results do not depend on how many there are, nor on their order."""

import functools
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, replace

from canarm_protocol.cell import Cell

from .evidence import Evidence
from .foreign_run import run_foreign
from .judgement import judge
from .plan import MatrixCell, Scenario
from .rig_run import false_alarms, run_in_rig
from .table import FalseAlarm, Matrix, Row

FAULT_FREE_RUNS = 20
PAYLOAD_FACTORS = (1.0, 0.5, 1.5, 0.75, 1.25)
"""What the last link weighs in the fault-free runs, as a multiple of what the controller thinks; in turns."""
FIRST_ALARM_SEED = 1
Progress = Callable[[int, int], None]


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


@dataclass(frozen=True, slots=True)
class _Task:
    """One run: of a fault, or without any where `fault` is None."""

    scenario: Scenario
    fault: MatrixCell | None
    controller: str | None
    number: int = 0


_Result = Row | tuple[FalseAlarm, ...]


def run_campaign(campaign: Campaign, jobs: int = 1, on_progress: Progress | None = None) -> Matrix:
    """Run all of it with `jobs` processes; `on_progress(done, all)` is told after every run.

    Raises what the twin's run raises. What goes wrong in the run of a fault is in its row.
    """
    tasks = [_Task(campaign.scenario, cell, campaign.controller) for cell in campaign.cells]
    alarms_of = 0 if campaign.controller is not None else campaign.fault_free_runs
    tasks += [_Task(campaign.scenario, None, None, number) for number in range(alarms_of)]
    results: list[_Result | None] = [None] * len(tasks)
    for done, (place, result) in enumerate(_results(tasks, jobs), start=1):
        results[place] = result
        if on_progress is not None:
            on_progress(done, len(tasks))
    rows = tuple(each for each in results if isinstance(each, Row))
    alarms = tuple(alarm for each in results if isinstance(each, tuple) for alarm in each)
    return Matrix(campaign.title, rows, alarms_of, alarms)


def _results(tasks: Sequence[_Task], jobs: int) -> Iterator[tuple[int, _Result]]:
    """Number and result of every task, as they come."""
    if jobs <= 1 or len(tasks) <= 1:
        yield from ((place, _run(task)) for place, task in enumerate(tasks))
        return
    executor = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _leave_interrupts_to_parent)
    try:
        places: dict[Future[_Result], int] = {executor.submit(_run, task): place for place, task in enumerate(tasks)}
        while places:
            for future in wait(places, return_when=FIRST_COMPLETED).done:
                yield places.pop(future), future.result()
    finally:
        executor.shutdown(cancel_futures=True)


def _leave_interrupts_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _run(task: _Task) -> _Result:
    cell, fault = _load(task.scenario), task.fault
    if fault is None:
        return _fault_free(task.scenario, cell, task.number)
    twin = _twin(task.scenario, fault.needs_wire, task.controller)
    try:
        run = _evidence(task.scenario, cell, fault, fault.needs_wire, task.controller)
        return Row.of(fault, judge(cell, run, twin, fault.is_dangerous))
    except Exception as error:
        return Row.broken(fault, error)


def _fault_free(scenario: Scenario, cell: Cell, number: int) -> tuple[FalseAlarm, ...]:
    factor, seed = PAYLOAD_FACTORS[number % len(PAYLOAD_FACTORS)], scenario.seed + FIRST_ALARM_SEED + number
    name = f"seed {seed}, payload x {factor:g}"
    notices = false_alarms(replace(scenario, seed=seed), cell, factor)
    return tuple(FalseAlarm(name, each.detector, each.where, each.cycle) for each in notices)


@functools.lru_cache(maxsize=2)
def _load(scenario: Scenario) -> Cell:
    return scenario.load()


@functools.lru_cache(maxsize=4)
def _twin(scenario: Scenario, with_wire: bool, controller: str | None) -> Evidence:
    """The fault-free run; once a process."""
    return _evidence(scenario, _load(scenario), None, with_wire, controller)


def _evidence(
    scenario: Scenario, cell: Cell, fault: MatrixCell | None, with_wire: bool, controller: str | None
) -> Evidence:
    if controller is not None:
        return run_foreign(scenario, cell, fault, controller, with_wire)
    return run_in_rig(scenario, cell, fault, with_wire)
