"""What a process can do, and ask of the machine, so that nothing delays its cycles.

Owns the calls to interpreter and operating system; docs/wall-clock.md has the measured effect of each. Calls that only
Linux has are left out elsewhere. Buses and deadlines never enter.
"""

import contextlib
import ctypes
import gc
import os
import sys
import time
from collections.abc import Callable, Iterator

from .time_slice import PROMPT_NS, set_time_slice

PRIORITY = 49
"""Priority in SCHED_FIFO: just below the 50 of Linux's interrupt threads, without which no frame would arrive."""
COLLECT_CYCLES = 400
"""Cycles between two collections: one second at 2.5 ms."""
MARGIN = 3
"""A collection begins when this many times the duration of the last one is left of the cycle."""
PATIENCE = 10
"""After this many times `COLLECT_CYCLES` a collection is made even without time left: memory is bounded."""

_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30  # linux/prctl.h
_MCL_CURRENT = 1  # asm-generic/mman-common.h; the few machines with another number refuse this one
_LEAST_SLACK_NS = 1
"""0 would mean the thread's default, 50 µs."""


class Collector:
    """Python's garbage collection in the time that is left of a cycle.

    Only reference cycles need it. Our own loop makes none, but a user's law may.
    """

    def __init__(
        self, clock: Callable[[], int] = time.perf_counter_ns, collect: Callable[[], int] = gc.collect
    ) -> None:
        self._clock, self._collect = clock, collect
        self._cycles = 0
        self._cost_ns = 0
        self.collections = 0

    def cycle_done(self, left_ns: int) -> None:
        """Outputs are sent; `left_ns` are left until the next deadline."""
        self._cycles += 1
        if self._cycles < COLLECT_CYCLES:
            return
        if left_ns < MARGIN * self._cost_ns and self._cycles < PATIENCE * COLLECT_CYCLES:
            return
        started_ns = self._clock()
        self._collect()
        self._cost_ns = self._clock() - started_ns
        self._cycles = 0
        self.collections += 1


@contextlib.contextmanager
def undisturbed(clock: Callable[[], int] = time.perf_counter_ns) -> Iterator[Collector]:
    """Within this context only the `Collector` collects garbage, timers fire on time, and others give way.

    No collection looks at the objects that exist by now, nor afterwards, where some had been set aside before. Begins
    with a full collection, which can take longer than the cards wait for a heartbeat: do not enter it while they run.
    Needs no permission.
    """
    was_enabled, had_frozen = gc.isenabled(), gc.get_freeze_count() > 0
    gc.collect()
    gc.disable()
    gc.freeze()
    slack_ns, slice_ns = _timer_slack_ns(_LEAST_SLACK_NS), set_time_slice(PROMPT_NS)
    try:
        yield Collector(clock)
    finally:
        if slack_ns:
            _timer_slack_ns(slack_ns)
        if slice_ns:
            set_time_slice(slice_ns)
        if not had_frozen:
            gc.unfreeze()
        if was_enabled:
            gc.enable()


def ask_for_realtime() -> list[str]:
    """Real-time class SCHED_FIFO for this thread, and its memory kept from being paged out, until the process ends.

    Returns a line for each that was refused. Threads and processes that are started later do not inherit the class.
    """
    refused = []
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except AttributeError:
        refused.append(f"real-time class: {sys.platform} has no SCHED_FIFO; the run goes on without")
    except OSError as error:
        refused.append(
            f"real-time class: {error.strerror}; allow it with `ulimit -r {PRIORITY}` or CAP_SYS_NICE; "
            "the run goes on without"
        )
    # Memory that is mapped later is not locked: under a limit (`ulimit -l`) it would run out in the middle of a run.
    why = _memory_lock()
    if why is not None:
        refused.append(f"memory lock: {why}; the run goes on without")
    return refused


def _timer_slack_ns(wanted_ns: int) -> int:
    """Set this thread's timer slack and return the old one; 0 if there is none, as in a real-time class."""
    if sys.platform != "linux":
        return 0
    prctl = ctypes.CDLL(None).prctl
    prctl.argtypes, prctl.restype = [ctypes.c_int, *[ctypes.c_ulong] * 4], ctypes.c_int
    before_ns = int(prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0))
    if before_ns <= 0:
        return 0
    prctl(_PR_SET_TIMERSLACK, wanted_ns, 0, 0, 0)
    return before_ns


def _memory_lock() -> str | None:
    """Why the memory could not be locked, or None."""
    if sys.platform != "linux":
        return f"not known how on {sys.platform}"
    if ctypes.CDLL(None, use_errno=True).mlockall(_MCL_CURRENT) == 0:
        return None
    return f"{os.strerror(ctypes.get_errno())}; allow it with `ulimit -l unlimited` or CAP_IPC_LOCK"
