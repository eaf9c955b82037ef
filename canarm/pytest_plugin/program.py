"""A program under test as a process: any command, its output, and its end. Its bus is not known here."""

import contextlib
import math
import os
import shlex
import signal
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from canarm_protocol.shown import first_line

from ..usage import UsageError

END_S = 5.0
"""How long it may take to end once asked, before it is killed."""
SHOWN = 2000
"""The last characters of its output that an error shows."""


def check_limit(seconds: float, source: str) -> None:
    """Raises `UsageError` for a time limit, given in `source`, that is infinite or not a time."""
    __tracebackhide__ = True
    if not 0.0 <= seconds < math.inf:
        raise UsageError(f"{source} {seconds:g}: must be a number of seconds, at least 0")


class Program:
    """`command`, started in its own session in folder `cwd`; its stdout and stderr go to `log`."""

    def __init__(
        self,
        command: str | Sequence[str | os.PathLike[str]],
        log: Path,
        cwd: Path | None = None,
        env: Mapping[str, str] | None = None,
        replace: Mapping[str, str] | None = None,
    ) -> None:
        """Start it. A string is split as by a shell; the keys of `replace` are replaced in every word.

        Raises `UsageError` for a malformed command, and if it cannot be started.
        """
        words = _words(command, replace or {})
        self.command, self._log = shlex.join(words), log
        self._is_end_known = False
        with log.open("wb") as output:
            try:
                self._process = subprocess.Popen(
                    words,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    cwd=cwd,
                    env={**os.environ, "PYTHONUNBUFFERED": "1", **(env or {})},
                    start_new_session=True,
                )
            except (OSError, ValueError) as error:
                why = error.strerror if isinstance(error, OSError) else str(error)
                where = f" in {cwd}" if cwd is not None else ""
                raise UsageError(f"command {self.command}: cannot be started{where}: {why}") from None

    @property
    def status(self) -> int | None:
        """Exit status, negative for a signal; None while it runs."""
        return self._process.poll()

    @property
    def has_left(self) -> bool:
        """Whether it has ended by itself, and `wait` has not been called since."""
        return not self._is_end_known and self.status is not None

    @property
    def output(self) -> str:
        """Its output so far."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def wait(self, timeout: float) -> int:
        """Wait for its exit status. Raises `TimeoutError` if it has not ended within `timeout` s.

        Raises `UsageError` for an infinite `timeout`.
        """
        __tracebackhide__ = True
        check_limit(timeout, "wait: timeout")
        try:
            status = self._process.wait(timeout)
            self._is_end_known = True
            return status
        except subprocess.TimeoutExpired:
            raise TimeoutError(f"still running after {timeout:g} s: {self}") from None

    def kill(self) -> None:
        """Kill it and its children with SIGKILL, without a chance to leave anything safe."""
        self._is_end_known = True
        self._signal(getattr(signal, "SIGKILL", signal.SIGTERM))
        self._process.wait(END_S)

    def interrupt(self) -> None:
        """Interrupt it, as Ctrl-C does."""
        self._is_end_known = True
        self._signal(signal.SIGINT)

    def end(self) -> None:
        """Ask it to end, and kill it if it does not. May be called again."""
        if self._process.poll() is None:
            self._signal(signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(END_S)
        if self._process.poll() is None:
            self.kill()

    def _signal(self, number: signal.Signals) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if self._process.poll() is not None:
                return
            if hasattr(os, "killpg"):
                os.killpg(self._process.pid, number)
            else:
                self._process.send_signal(number)

    def __repr__(self) -> str:
        state = "running" if self.status is None else f"ended with status {self.status}"
        said = self.output.strip()[-SHOWN:]
        return f"<{self.command}: {state}{', said: ' + said if said else ', said nothing'}>"


def _words(command: str | Sequence[str | os.PathLike[str]], replace: Mapping[str, str]) -> list[str]:
    if isinstance(command, str):
        try:
            words = shlex.split(command)
        except ValueError as error:
            raise UsageError(f"command {command}: {first_line(error)}") from None
    else:
        words = [os.fspath(word) for word in command]
    if not words:
        raise UsageError("command: is empty; must be a program and its arguments")
    for old, new in replace.items():
        words = [word.replace(old, new) for word in words]
    return words
