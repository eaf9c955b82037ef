"""Runs something in a copy of this process, so that what it changes is as it was afterwards. Knows nothing of runs."""

import contextlib
import gc
import os
import pickle
import signal
import sys
import warnings
from collections.abc import Callable
from typing import BinaryIO, TypeVar, cast

from .pool import LostWorkerError

_Result = TypeVar("_Result")
CAN_FORK = sys.platform == "linux"
"""Elsewhere there is no fork, or libraries that do not survive it."""
TRIES = 2
_KEPT_BACK = (signal.SIGINT, signal.SIGTERM) if sys.platform != "win32" else ()


def in_copy(run: Callable[[], _Result]) -> _Result:
    """What `run` returns, which can be pickled. The copy ends with it, and is killed where this process is interrupted.

    A copy that is ended from outside is tried once more. Raises `LostWorkerError` where that ends as well, or where
    `run` raises: what is to be told of an error has to be in what it returns.
    """
    for _ in range(TRIES):
        said = _said_by_copy(run)
        if said:
            return cast(_Result, pickle.loads(said))
    raise LostWorkerError("its process was ended from outside")


def _said_by_copy(run: Callable[[], object]) -> bytes:
    """The result, pickled; empty where the copy did not come to it."""
    read_end, write_end = os.pipe()
    with os.fdopen(read_end, "rb") as pipe:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _KEPT_BACK)  # until an interrupt of either side ends the copy
        gc.freeze()  # a collection in the copy would otherwise write into every object, and so copy each page
        try:
            pid = _fork()
            if not pid:
                _be_copy(run, write_end, before)
            return _awaited(pid, pipe, write_end, before)
        finally:
            gc.unfreeze()
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _awaited(pid: int, pipe: BinaryIO, write_end: int, mask: set[int | signal.Signals]) -> bytes:
    """What copy `pid` says. However this is left, the copy has ended."""
    has_ended = False
    try:
        os.close(write_end)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        said = pipe.read()
        _, status = os.waitpid(pid, 0)
        has_ended = True
        return said if status == 0 else b""
    finally:
        if not has_ended:
            with contextlib.suppress(ProcessLookupError, ChildProcessError):
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)


def _fork() -> int:
    with warnings.catch_warnings():
        # Other threads hold no lock that the copy wants: it computes, writes into its pipe, and is gone.
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def _be_copy(run: Callable[[], object], write_end: int, mask: set[int | signal.Signals]) -> None:
    """The life of the copy. Never returns: buffers, exit handlers and frames above are this process's twice now."""
    status = 1
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: the original is interrupted too, and kills
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        gc.disable()  # it is gone before its garbage matters
        said = pickle.dumps(run())
        with os.fdopen(write_end, "wb") as pipe:
            pipe.write(said)
        status = 0
    finally:
        os._exit(status)
