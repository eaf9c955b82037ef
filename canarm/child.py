"""Our own commands as child processes: starting one, waiting for what it says, ending it. Nothing of what they do."""

import contextlib
import os
import re
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from typing import Self

from .cli import ENVIRONMENT_PREFIX, LOG_LEVEL

END_S = 10.0
"""How long a process may take to end when it is asked to; a safe stop takes 2 s."""


class Child:
    """`canarm command …` as a process in a session of its own: Ctrl-C at the terminal does not reach it by itself.

    It ends when this process does. With `quiet`, what it says on stderr is kept in `complaints` instead of shown.
    Leaving a `with` statement ends it.
    """

    def __init__(self, command: str, arguments: Sequence[str], quiet: bool = False) -> None:
        self.command = command
        self._errors = tempfile.TemporaryFile() if quiet else None  # noqa: SIM115 (closed by `__exit__`)
        # -P: what lies in the working folder must not be taken for our own packages.
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "canarm", command, *arguments, "--with-parent"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,
            env=_environment(),
        )
        self._printed = b""

    @property
    def status(self) -> int | None:
        """Exit status, negative for a signal; None while the process runs."""
        return self._process.poll()

    @property
    def printed(self) -> str:
        """What the process has printed, as far as it was waited for."""
        return self._printed.decode(errors="replace")

    @property
    def complaints(self) -> str:
        """What a quiet process has said on stderr."""
        if self._errors is None:
            return ""
        self._errors.seek(0)
        return self._errors.read().decode(errors="replace")

    def wait_for(self, pattern: str, limit_s: float) -> re.Match[str] | None:
        """The first match in what the process prints; None when it ends, or `limit_s` passes, without one."""
        assert self._process.stdout is not None
        fd = self._process.stdout.fileno()
        deadline_s = time.monotonic() + limit_s
        while (match := re.search(pattern, self.printed, re.MULTILINE)) is None:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0 or not select.select([fd], [], [], left_s)[0]:
                return None
            data = os.read(fd, 4096)
            if not data:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(END_S)
                return None
            self._printed += data
        return match

    def wait(self, limit_s: float) -> None:
        """Wait for the end of the process; it is killed after `limit_s`."""
        if self._process.stdout is not None and self._process.stdout.closed:
            return
        try:
            rest, _ = self._process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            rest, _ = self._process.communicate()
        self._printed += rest

    def end(self) -> None:
        """Ask the process to end, and insist when it does not. May be called again."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
        self.wait(END_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.end()
        if self._errors is not None:
            self._errors.close()


def _environment() -> dict[str, str]:
    """Ours, without the options given in it: those are passed on by name, to the command that they are for."""
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(ENVIRONMENT_PREFIX) or name == LOG_LEVEL
    }
