"""Keeping what watches a loop to one core, and out of the way of the loop. Owns which cores a thread may run on.

A loop that wakes every few milliseconds is late where its core is inside the kernel for somebody else, and where it has
to be sent to another core that sleeps. With the watcher on one core, the processes of the loop settle on the others.
"""

import contextlib
import os
import sys
from collections.abc import Iterator

_allowed: frozenset[int] = frozenset()
"""What this process might run on before it was kept to one core; empty if it is not."""


@contextlib.contextmanager
def on_one_core() -> Iterator[None]:
    """Keep this thread, and threads that it starts, to the last of its cores. Linux only; elsewhere nothing is done."""
    global _allowed
    cores = _cores()
    if len(cores) < 2 or not _keep_to(frozenset({max(cores)})):
        yield
        return
    before, _allowed = _allowed, cores
    try:
        yield
    finally:
        _allowed = before
        _keep_to(cores)


@contextlib.contextmanager
def on_all_cores() -> Iterator[None]:
    """For processes that this thread starts meanwhile: they may run wherever this one might."""
    kept, allowed = _cores(), _allowed
    if not allowed or kept == allowed or not _keep_to(allowed):
        yield
        return
    try:
        yield
    finally:
        _keep_to(kept)


def _cores() -> frozenset[int]:
    return frozenset(os.sched_getaffinity(0)) if sys.platform == "linux" else frozenset()


def _keep_to(cores: frozenset[int]) -> bool:
    try:
        if sys.platform == "linux":
            os.sched_setaffinity(0, cores)
    except OSError:  # a container may forbid it, and cores may be switched off
        return False
    return True
