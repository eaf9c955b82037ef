"""Runs tasks on several cores, and ends what runs when it is left early. Knows nothing of what the tasks do."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from types import FrameType
from typing import TypeVar

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


def results_of(
    run: Callable[[_Task], _Result], tasks: Sequence[_Task], jobs: int
) -> Generator[tuple[int, _Result], None, None]:
    """Number and result of every task, as they come; with one job, or one task, in this process.

    `run` is a function of a module, and tasks and results can be pickled. Closing the iterator early, or an interrupt,
    ends the tasks that run: `SystemExit` is raised in each of them, once, so that its `with` statements are left.
    """
    if jobs <= 1 or len(tasks) <= 1:
        yield from ((place, run(task)) for place, task in enumerate(tasks))
        return
    strangers = set(multiprocessing.active_children())
    executor = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _end_when_told)
    try:
        with _interrupts_ignored():  # by the workers from their beginning: they inherit it
            places: dict[Future[_Result], int] = {
                executor.submit(_run_until_told, run, task): place for place, task in enumerate(tasks)
            }
        while places:
            for future in wait(places, return_when=FIRST_COMPLETED).done:
                yield places.pop(future), future.result()
    except BaseException:
        with _interrupts_ignored():  # an impatient second one would leave processes behind
            for worker in set(multiprocessing.active_children()) - strangers:
                worker.terminate()
            executor.shutdown(cancel_futures=True)
        raise
    executor.shutdown()


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _end_when_told() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)


def _end(number: int, frame: FrameType | None) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the way out is not to be interrupted
    raise SystemExit(1)


def _run_until_told(run: Callable[[_Task], _Result], task: _Task) -> _Result:
    try:
        return run(task)
    except SystemExit:
        os._exit(1)  # the executor's worker would take it for the task's result, and go on with the next
