"""Our own commands as child processes: start one, wait for its output, end it. What they do is not known here."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from typing import IO, Self

from canarm_protocol.errors import BusError, ExitStatus
from canarm_protocol.transport.one_core import on_all_cores

from .cli import ENVIRONMENT_PREFIX, LOG_LEVEL
from .stopping import signals_held_back
from .usage import UsageError

START_S = 300.0
"""How long a process may take to report that it is ready: a cold start reads a physics engine from disk, and an
emulated machine may be 25 times slower than its host."""
END_S = 10.0
"""How long a process may take to end once asked; a safe stop takes 2 s."""
KEPT = 256 * 1024
"""Bytes of a process's output that are kept; a summary takes about a hundred per joint."""
LAST_WORDS_S = 1.0
"""How long a pipe may stay open after its process has ended: a grandchild may hold it."""


class Child:
    """`canarm command …` as a process in its own session, which Ctrl-C at the terminal does not reach.

    It ends when this process does, and never blocks on unread output. With `quiet`, its stderr is
    kept in `complaints` instead of shown. Leaving a `with` statement ends it.
    """

    def __init__(self, command: str, arguments: Sequence[str], quiet: bool = False) -> None:
        self.command = command
        # -P: a file in the working folder must not shadow our packages.
        with on_all_cores():
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "canarm", command, *arguments, "--with-parent"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE if quiet else None,
                start_new_session=True,
                env=_environment(),
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._words = self._process.stdin
        self._output = _Drain(self._process.stdout)
        self._errors = None if self._process.stderr is None else _Drain(self._process.stderr)

    @property
    def status(self) -> int | None:
        """Exit status, negative for a signal; None while the process runs."""
        return self._process.poll()

    @property
    def printed(self) -> str:
        """The last `KEPT` bytes of its stdout."""
        return self._output.text

    @property
    def complaints(self) -> str:
        """The last `KEPT` bytes of a quiet process's stderr."""
        return "" if self._errors is None else self._errors.text

    def wait_for(self, pattern: str, limit_s: float) -> re.Match[str] | None:
        """The first match in the process's stdout; None if it ends, or `limit_s` passes, without one."""
        match = self._output.wait_for(pattern, limit_s)
        if match is None and self._output.has_ended:
            self.wait(END_S)
        return match

    def wait(self, limit_s: float) -> bool:
        """Wait until the process and its output have ended; False if they have not within `limit_s`."""
        try:
            self._process.wait(limit_s)
        except subprocess.TimeoutExpired:
            return False
        for drain in (self._output, self._errors):
            if drain is not None:
                drain.join(LAST_WORDS_S)
        return True

    def end(self, why: str = "") -> None:
        """Ask the process to end, and kill it if it does not. It is told `why`. May be called again."""
        with contextlib.suppress(OSError):
            if why and not self._words.closed:
                self._words.write(f"{why}\n".encode())
            self._words.close()
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
        if not self.wait(END_S):
            self._process.kill()
            self.wait(END_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.end()


@contextlib.contextmanager
def running(command: str, arguments: Sequence[str], quiet: bool = False) -> Iterator[Child]:
    """A `Child` that is ended on exit, also if a signal comes while it is started."""
    child: Child | None = None
    try:
        with signals_held_back():
            child = Child(command, arguments, quiet)
        yield child
    finally:
        if child is not None:
            child.end()


def offered_port(emulator: Child) -> int:
    """The port on which an emulator serves its buses, from the line that it prints.

    Ends an emulator that prints none, and raises `UsageError` if its arguments were wrong, else `BusError`.
    """
    found = emulator.wait_for(r"^bench .*port=(\d+)\b", START_S)
    if found is not None:
        return int(found.group(1))
    if emulator.status is None:
        emulator.end()
        raise BusError(f"the emulator has not offered its buses within {START_S:g} s")
    words = " ".join(emulator.complaints.split())
    raise ended_too_early(emulator, words or f"the emulator has ended with status {emulator.status}")


def ended_too_early(child: Child, text: str) -> Exception:
    """The error for a process that has ended: its wrong usage is ours."""
    return (UsageError if child.status == ExitStatus.WRONG_INPUT else BusError)(text)


class _Drain:
    """Reads a pipe in a thread as fast as it fills, and keeps the last `KEPT` bytes."""

    def __init__(self, pipe: IO[bytes]) -> None:
        self._pipe = pipe
        self._kept = b""
        self._news = threading.Condition()
        self.has_ended = False
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    @property
    def text(self) -> str:
        return self._kept.decode(errors="replace")

    def wait_for(self, pattern: str, limit_s: float) -> re.Match[str] | None:
        """The first match in the bytes kept; None at the end of the pipe, or after `limit_s`."""
        deadline_s = time.monotonic() + limit_s
        with self._news:
            while (match := re.search(pattern, self.text, re.MULTILINE)) is None:
                left_s = deadline_s - time.monotonic()
                if self.has_ended or left_s <= 0.0:
                    return None
                self._news.wait(left_s)
        return match

    def join(self, limit_s: float) -> None:
        """Wait for the end of the pipe."""
        self._thread.join(limit_s)

    def _read(self) -> None:
        with contextlib.suppress(OSError), self._pipe:
            while data := os.read(self._pipe.fileno(), 65536):
                with self._news:
                    self._kept = (self._kept + data)[-KEPT:]
                    self._news.notify_all()
        with self._news:
            self.has_ended = True
            self._news.notify_all()


def _environment() -> dict[str, str]:
    """Our environment without canarm's options: those are passed explicitly to the command they are for."""
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(ENVIRONMENT_PREFIX) or name == LOG_LEVEL
    }
