"""Tasks on a Dask cluster that runs already. Its workers need canarm, and the files that the study names."""

import contextlib
import queue
import threading
import time
from collections.abc import Generator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from canarm_protocol.shown import first_line, printable

from ..cli import version
from ..libraries import load_library
from ..usage import UsageError
from .one_run import Row, Task, broken, run_task
from .running import Runner

ATTACH_S = 10.0
"""How long a scheduler is waited for, and its first worker."""
WAITING = 4
"""Tasks per thread of the cluster that are handed over at a time: the scheduler's memory does not grow with a study."""
ALONE_S = 120.0
"""A cluster that has had no worker for so long is given up."""
LOOK_UP_S = 1.0
_turn = threading.Lock()


def on_cluster(address: str) -> Runner:
    """Tasks on the Dask scheduler at `address`. Raises `MissingLibraryError`, and `UsageError` if none answers."""
    distributed = load_library("distributed", "--scheduler")
    where = f"--scheduler {printable(address)}"
    try:
        client = distributed.Client(address, timeout=ATTACH_S, set_as_default=False)
    except Exception as error:  # a wrong address, nobody there, other versions: each its own
        raise UsageError(f"{where}: no Dask scheduler answers: {first_line(error)}") from None
    try:
        client.wait_for_workers(1, timeout=ATTACH_S)
    except Exception:
        client.close()
        raise UsageError(f"{where}: it has no workers; start some: dask worker {printable(address)}") from None
    try:
        _check_workers(client, where)
    except UsageError:
        client.close()
        raise
    return partial(_results, client, where)


def version_there() -> str:
    """The version of canarm in the process that is asked."""
    return version()


def _check_workers(client: Any, where: str) -> None:
    """Refuse workers that would run something else. Raises `UsageError`."""
    try:
        there = set(client.run(version_there).values())
    except Exception as error:
        raise UsageError(f"{where}: its workers cannot run canarm; install it there: {first_line(error)}") from None
    if there != {version()}:
        found = ", ".join(sorted(map(str, there)))
        raise UsageError(f"{where}: its workers have canarm {found}; this is {version()}: they must be the same")


def run_alone(task: Task) -> Row:
    """`run_task`, one at a time in a worker, which may have several threads: Python runs one of them at a time anyway,
    and the controller's tables are not made for two. With these threads, no copy of the process is made.
    """
    with _turn:
        return run_task(replace(task, shares=False))


def _results(client: Any, where: str, tasks: Sequence[Task]) -> Generator[tuple[int, Row], None, None]:
    places: dict[Any, int] = {}
    done: queue.SimpleQueue[Any] = queue.SimpleQueue()
    waiting = iter(range(len(tasks)))

    def hand_over(count: int) -> None:
        for _, place in zip(range(count), waiting, strict=False):
            # Not pure: two runs with one setting are two runs. A worker that dies is replaced by the scheduler, and
            # a run that has killed several is given up by it.
            future = client.submit(run_alone, tasks[place], pure=False)
            places[future] = place
            future.add_done_callback(done.put)

    try:
        hand_over(WAITING * max(sum(client.nthreads().values()), 1))
        while places:
            future = _next(client, where, done)
            place = places.pop(future)
            yield place, _row_of(future, tasks[place])
            hand_over(1)
    finally:
        with contextlib.suppress(Exception):  # a cluster that has gone away has nothing left to cancel
            client.cancel(list(places))
        client.close()


def _next(client: Any, where: str, done: "queue.SimpleQueue[Any]") -> Any:
    """The next future that is over. Raises `UsageError` when the cluster has gone away."""
    alone_s: float | None = None
    while True:
        with contextlib.suppress(queue.Empty):
            return done.get(timeout=LOOK_UP_S)
        has_workers = client.status == "running" and bool(client.nthreads())
        now_s = time.monotonic()
        alone_s = None if has_workers else (now_s if alone_s is None else alone_s)
        if alone_s is not None and now_s - alone_s > ALONE_S:
            raise UsageError(f"{where}: it has had no worker for {ALONE_S:g} s; what is done stays in the folder")


def _row_of(future: Any, task: Task) -> Row:
    if future.status == "finished":
        row: Row = future.result()
        return row
    return broken(task, future.exception() if future.status == "error" else f"the cluster has {future.status} it")
