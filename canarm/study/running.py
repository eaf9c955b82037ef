"""Runs a study, here or on a cluster, into its journal. Which runs, and what becomes of them, is decided elsewhere."""

import contextlib
from collections.abc import Callable, Generator, Sequence
from functools import partial

from ..workers.pool import LostWorkerError, results_of
from .journal import Journal
from .one_run import Row, Task, broken, run_task
from .plan import Sample, Study

Runner = Callable[[Sequence[Task]], Generator[tuple[int, Row], None, None]]
"""Carries out tasks: the place of each, and its row, as they come. Closing it early ends what runs."""
LEAST_SHARED = 3
"""With fewer fault files than that, a process seldom gets two runs that could share their beginning."""
OnProgress = Callable[[int, int], None]


class Tasks(Sequence[Task]):
    """The runs of `study` with these numbers, each made when it is asked for: a million settings are not kept."""

    def __init__(self, study: Study, numbers: Sequence[int]) -> None:
        self._study, self._numbers = study, numbers
        self._shares = (
            study.sample is Sample.GRID and study.axes[-1].name == "faults" and study.steps[-1] >= LEAST_SHARED
        )

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, place: int) -> Task:  # type: ignore[override]
        number = self._numbers[place]
        return Task(number, self._study.settings(number), tuple(self._study[number].items()), self._shares)


def on_this_machine(jobs: int) -> Runner:
    """Tasks in `jobs` processes of this machine. One whose process is lost twice is broken."""
    return partial(_results, jobs)


def _results(jobs: int, tasks: Sequence[Task]) -> Generator[tuple[int, Row], None, None]:
    return results_of(run_task, tasks, jobs, _lost)


def _lost(task: Task, error: LostWorkerError) -> Row:
    return broken(task, error)


def run_study(study: Study, journal: Journal, runner: Runner, on_progress: OnProgress) -> bool:
    """Run what the journal lacks; whether all is done. An interrupt ends it, and what is done stays.

    Raises `OSError` where the journal cannot be written.
    """
    for number in [each for each in journal.places if not 0 <= each < len(study)]:
        del journal.places[number]  # whoever has written that: it is no run of this study
    left = [number for number in range(len(study)) if number not in journal.places]
    on_progress(len(study) - len(left), len(study))
    with contextlib.suppress(KeyboardInterrupt), contextlib.closing(runner(Tasks(study, left))) as coming:
        for _, row in coming:
            journal.add(row)
            on_progress(len(journal.places), len(study))
    return len(journal.places) == len(study)
