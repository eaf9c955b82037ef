"""Runs tasks on several cores, and ends running ones when it is left early. What they do is not known here."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from queue import SimpleQueue
from types import FrameType
from typing import TypeVar

from ..stopping import HANGUP
from .memory import give_back

AHEAD = 4
"""Tasks for each worker that are handed over at a time: a million of them are not kept in memory."""
_Task = TypeVar("_Task")
_Result = TypeVar("_Result")
ORPHAN_S = 5.0
"""Seconds that a task gets to end in once the process that wanted its result is gone."""


class LostWorkerError(RuntimeError):
    """A worker process was ended from outside: killed, told to end, or out of memory."""


def results_of(
    run: Callable[[_Task], _Result],
    tasks: Sequence[_Task],
    jobs: int,
    lost: Callable[[_Task, LostWorkerError], _Result] | None = None,
) -> Generator[tuple[int, _Result], None, None]:
    """Number and result of every task, as they come; with one job, or one task, in this process.

    `run` is a module-level function; tasks and results must be picklable. Closing the iterator early, or an interrupt,
    ends the running tasks: `SystemExit` is raised once in each, so that its `with` statements are left.
    A worker that is ended from outside takes nothing else with it: what it may have run is tried once more by itself,
    and where that ends its worker again, `lost` gives the result (without it, `LostWorkerError` is raised).
    """
    if jobs <= 1 or len(tasks) <= 1:
        yield from ((place, run(task)) for place, task in enumerate(tasks))
        return
    waiting = list(range(len(tasks)))
    while waiting:
        suspects: list[int] = []
        with contextlib.closing(_until_broken(run, tasks, waiting, jobs)) as coming:
            for place, result in coming:
                if isinstance(result, LostWorkerError):
                    suspects.append(place)
                else:
                    waiting.remove(place)
                    yield place, result
        for place in suspects:  # each by itself, so that none suffers from another
            waiting.remove(place)
            ((_, result),) = _until_broken(run, tasks, [place], 1)
            if isinstance(result, LostWorkerError):
                if lost is None:
                    raise result
                result = lost(tasks[place], result)
            yield place, result


def _until_broken(
    run: Callable[[_Task], _Result], tasks: Sequence[_Task], waiting: Sequence[int], jobs: int
) -> Generator[tuple[int, _Result | LostWorkerError], None, None]:
    """Number and result of the waiting tasks, or `LostWorkerError` for those that a lost worker may have run.

    An executor that has lost a worker is unusable: it ends, and tasks that had not begun get no result.
    """
    strangers = set(multiprocessing.active_children())
    executor = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _begin_worker)
    # Not `concurrent.futures.wait`: an interrupt inside it leaves futures locked, and shutdown would hang.
    done: SimpleQueue[Future[_Result]] = SimpleQueue()
    places: dict[Future[_Result], int] = {}
    coming = iter(waiting[:])

    def hand_over(count: int) -> None:
        with _interrupts_ignored():  # by the workers from their beginning: they inherit it
            for _, place in zip(range(count), coming, strict=False):
                future = executor.submit(_run_until_told, run, tasks[place])
                places[future] = place
                future.add_done_callback(done.put)

    try:
        hand_over(AHEAD * jobs)
        while places:
            future = done.get()
            try:
                result: _Result | LostWorkerError = future.result()
            except BrokenProcessPool:
                # Tasks begin in the order of submission: those that ran are the first without a result.
                for place in list(places.values())[:jobs]:
                    yield place, LostWorkerError("its process was ended from outside")
                break
            except LostWorkerError as error:
                result = error
            place = places.pop(future)
            with contextlib.suppress(BrokenProcessPool):  # its tasks are told of that in their turn
                hand_over(1)
            yield place, result
    except BaseException:
        with _interrupts_ignored():  # an impatient second one would leave processes behind
            for worker in set(multiprocessing.active_children()) - strangers:
                worker.terminate()
            executor.shutdown(cancel_futures=True)
        raise
    executor.shutdown()


_INTERRUPTS = tuple(filter(None, (signal.SIGINT, HANGUP)))
"""What a terminal sends to all of its processes; it is the first one that ends the others."""


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in _INTERRUPTS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Worker:
    """The state of a worker process.

    Told to end, it leaves its task and then asks for the next one as usual, until the executor has none: ended
    anywhere else, it might hold a lock of the executor, and all others would wait for ever.
    """

    def __init__(self) -> None:
        self.is_told = False
        self.is_in_task = False
        self.task_over = threading.Event()

    def tell(self, number: int, frame: FrameType | None) -> None:
        was_told, self.is_told = self.is_told, True
        if self.is_in_task and not was_told:  # once: leaving must not be interrupted
            raise SystemExit(1)

    def end_with_parent(self) -> None:
        parent = multiprocessing.parent_process()
        assert parent is not None
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        if self.is_in_task:
            self.task_over.wait(ORPHAN_S)
        os._exit(1)


_worker = _Worker()


def _begin_worker() -> None:
    for number in _INTERRUPTS:
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _worker.tell)
    threading.Thread(target=_worker.end_with_parent, daemon=True).start()


def _run_until_told(run: Callable[[_Task], _Result], task: _Task) -> _Result:
    _worker.task_over.clear()
    try:
        _worker.is_in_task = True
        if _worker.is_told:
            raise SystemExit(1)
        return run(task)
    except SystemExit:
        raise LostWorkerError("its process was told to end") from None
    finally:
        _worker.is_in_task = False
        _worker.task_over.set()
        give_back()
