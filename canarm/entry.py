"""The program `canarm`, before anything else is imported: a signal ends it with a line, as it does later.

Nothing that is slow to import belongs here.
"""

import gc
import os
import signal
import sys
from types import FrameType, TracebackType
from typing import Protocol

from .streams import make_streams_safe

FAILED = 1


def main() -> None:
    """Import the command line and run it. SIGINT, SIGTERM and SIGHUP before a command has begun are status 1.

    They end the process at once: an exception does not always get through; the initialization of an extension
    module, for example, turns it into an `ImportError`.
    """
    _end_on_signals()
    make_streams_safe()
    gc.disable()  # until the command is imported: collecting garbage among modules costs a tenth of the start
    sys.unraisablehook = _end_where_an_interrupt_is_lost
    try:
        from .cli import main as run_command_line

        run_command_line()
    except KeyboardInterrupt:
        _end_on_signals()  # a further one would end the process by the signal
        print("canarm: interrupted", file=sys.stderr)
        sys.exit(FAILED)


class _Unraisable(Protocol):
    """The part of `sys.unraisablehook`'s argument that is used here."""

    @property
    def exc_type(self) -> type[BaseException]: ...
    @property
    def exc_traceback(self) -> TracebackType | None: ...


def _end_on_signals() -> None:
    for number in filter(None, (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", None))):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end_now)


def _end_now(number: int, frame: FrameType | None) -> None:
    try:
        os.write(2, b"canarm: interrupted\n")
    finally:
        os._exit(FAILED)


def _end_where_an_interrupt_is_lost(unraisable: _Unraisable) -> None:
    """Ctrl-C during a finalizer or a callback of the garbage collector would be lost there."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        _end_now(signal.SIGINT, None)
    sys.__unraisablehook__(unraisable)  # type: ignore[arg-type]
