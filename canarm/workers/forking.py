"""Runs a function in a copy of this process, which discards its changes. Runs of the matrix are not known here."""

import contextlib
import gc
import os
import pickle
import signal
import sys
import warnings
from collections.abc import Callable
from multiprocessing.connection import wait
from typing import BinaryIO, TypeVar, cast

from ..stopping import signals_held_back
from .pool import LostWorkerError

_Result = TypeVar("_Result")
CAN_FORK = sys.platform == "linux"
"""Other systems have no fork, or libraries that do not survive it."""
TRIES = 2
LOOK_UP_S = 0.2
"""How long an interrupt may wait."""


def in_copy(run: Callable[[], _Result]) -> _Result:
    """The picklable result of `run`. The copy then ends; it is killed if this process is interrupted.

    A copy that is ended from outside is tried once more. Raises `LostWorkerError` if that ends too, or if
    `run` raises: errors must be part of its result.
    """
    for _ in range(TRIES):
        said = _said_by_copy(run)
        if said:
            return cast(_Result, pickle.loads(said))
    raise LostWorkerError("its process was ended from outside")


def _said_by_copy(run: Callable[[], object]) -> bytes:
    """The pickled result; empty if the copy ended before."""
    read_end, write_end = os.pipe()
    with os.fdopen(read_end, "rb") as pipe, contextlib.ExitStack() as holding:
        holding.enter_context(signals_held_back())  # until an interrupt of either side ends the copy
        gc.freeze()  # a collection in the copy would otherwise write into every object, and so copy each page
        try:
            pid = _fork()
            if not pid:
                _be_copy(run, write_end)
            return _awaited(pid, pipe, write_end, holding)
        finally:
            gc.unfreeze()


def _awaited(pid: int, pipe: BinaryIO, write_end: int, holding: contextlib.ExitStack) -> bytes:
    """The output of copy `pid`, which has ended whichever way this is left; signals are no longer held back."""
    has_ended = False
    try:
        os.close(write_end)
        holding.close()
        said = _read_to_end(pipe)
        _, status = os.waitpid(pid, 0)
        has_ended = True
        return said if status == 0 else b""
    finally:
        if not has_ended:
            with contextlib.suppress(ProcessLookupError, ChildProcessError):
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)


def _read_to_end(pipe: BinaryIO) -> bytes:
    """All that comes. A signal just before a read that blocks would not be handled before that read ends."""
    said = bytearray()
    while True:
        if wait([pipe.fileno()], LOOK_UP_S):
            chunk = os.read(pipe.fileno(), 1 << 20)
            if not chunk:
                return bytes(said)
            said += chunk


def _fork() -> int:
    with warnings.catch_warnings():
        # Other threads hold no lock that the copy wants: it computes, writes into its pipe, and is gone.
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def _be_copy(run: Callable[[], object], write_end: int) -> None:
    """Run the copy. Never returns: buffers, exit handlers and stack frames belong to the original."""
    status = 1
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: the original is interrupted too, and kills
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        gc.disable()  # it is gone before its garbage matters
        said = pickle.dumps(run())
        with os.fdopen(write_end, "wb") as pipe:
            pipe.write(said)
        status = 0
    finally:
        os._exit(status)
