"""Runs tasks on several cores, and ends what runs when it is left early. Knows nothing of what the tasks do."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from queue import SimpleQueue
from types import FrameType
from typing import TypeVar

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")
ORPHAN_S = 5.0
"""Seconds that a task is given to end in, once the process that wanted its result is no more."""


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
    executor = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _begin_worker)
    # Not `concurrent.futures.wait`: an interrupt in it leaves futures locked, and the shutdown would wait for ever.
    done: SimpleQueue[Future[_Result]] = SimpleQueue()
    try:
        with _interrupts_ignored():  # by the workers from their beginning: they inherit it
            places = {executor.submit(_run_until_told, run, task): place for place, task in enumerate(tasks)}
            for future in places:
                future.add_done_callback(done.put)
        while places:
            future = done.get()
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


class _Worker:
    """What a worker process knows of itself.

    Being told to end, it leaves its task and then asks for the next one as ever, until the executor has none: ended
    anywhere else it may hold a lock of the executor, and all the others would wait for it for ever.
    """

    def __init__(self) -> None:
        self.is_told = False
        self.is_in_task = False
        self.task_over = threading.Event()

    def tell(self, number: int, frame: FrameType | None) -> None:
        was_told, self.is_told = self.is_told, True
        if self.is_in_task and not was_told:  # once: the way out is not to be interrupted
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
    signal.signal(signal.SIGINT, signal.SIG_IGN)
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
        raise RuntimeError("the worker process was told to end") from None
    finally:
        _worker.is_in_task = False
        _worker.task_over.set()
