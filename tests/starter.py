"""Python programs in processes that need not import canarm: they are forks of one that has imported it already.

To a test they are processes like others, with an end of their own, signals, pipes, a session, a folder and an
environment; they only start in a tenth of the time. What they share is the seed of hashes, and what a module reads of
the environment while it is imported: where a test is about either, it starts an interpreter.
"""

import gc
import importlib
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

CAN_FORK = sys.platform == "linux"
IMPORTED = ("check", "controller", "demo", "emulator", "export", "fault", "fault_matrix", "jog", "new_cell", "reset")
START_S = 300.0
"""Until the first fork there is, everything is imported: on an emulated machine that takes its time."""
MOST_BYTES = 1 << 16
"""Of a message; an environment is the longest part."""


class Forked:
    """As much of `subprocess.Popen` as the tests need; `stdout` and `stderr` are None where they go elsewhere."""

    def __init__(self, starter: "Starter", pid: int, stdout: TextIO | None, stderr: TextIO | None) -> None:
        self._starter, self.pid, self.stdout, self.stderr = starter, pid, stdout, stderr

    def poll(self) -> int | None:
        """Exit status, negative for a signal; None while it runs."""
        return self._starter.status_of(self.pid, 0.0)

    @property
    def returncode(self) -> int | None:
        return self.poll()

    def kill(self) -> None:
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)

    def communicate(self, timeout: float) -> tuple[str, str]:
        """What it says on both outputs, and its end."""
        assert self.stdout is not None
        assert self.stderr is not None
        said = []
        reader = threading.Thread(target=lambda: said.append(self.stdout.read()), daemon=True)
        reader.start()
        complaint = self.stderr.read()
        self.wait(timeout)
        reader.join(timeout)
        return said[0], complaint

    def wait(self, timeout: float) -> int:
        """The exit status. Raises `TimeoutExpired`."""
        limit = time.monotonic() + timeout
        while (status := self._starter.status_of(self.pid, max(limit - time.monotonic(), 0.0))) is None:
            if time.monotonic() >= limit:
                raise subprocess.TimeoutExpired(f"fork {self.pid}", timeout)
        return status


class Starter:
    """The process that forks: begun when a start is first asked for, ended by `close` or with the test process."""

    def __init__(self) -> None:
        self._socket: socket.socket | None = None
        self._started: int | None = None
        self._statuses: dict[int, int] = {}

    def start(
        self, words: Sequence[str], folder: Path, environment: Mapping[str, str], stdio: Sequence[int | None] = ()
    ) -> Forked:
        """What `python WORDS` starts; there must be `-m`, `-c` or a file.

        `stdio` are the descriptors that it gets; by default there is nothing on stdin, and both outputs are pipes.
        """
        if self._socket is None:
            self._socket = self._begin()
        stdin, *outputs = stdio or (None, None, None)
        pipes = [os.pipe() if fd is None else (None, fd) for fd in outputs]
        nothing = os.open(os.devnull, os.O_RDONLY)
        fds = [nothing if stdin is None else stdin, *(theirs for _, theirs in pipes)]
        request = {"words": list(words), "folder": str(folder), "environment": dict(environment)}
        socket.send_fds(self._socket, [json.dumps(request).encode()], fds)
        for fd in (nothing, *(theirs for ours, theirs in pipes if ours is not None)):
            os.close(fd)
        self._started = None
        while self._started is None:
            assert self._hear(START_S), "no fork was made"
        return Forked(self, self._started, *(None if ours is None else os.fdopen(ours) for ours, _ in pipes))

    def status_of(self, pid: int, limit_s: float) -> int | None:
        """The exit status of a fork; None if none has come within `limit_s`."""
        while pid not in self._statuses and self._hear(limit_s):
            pass
        return self._statuses.get(pid)

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._process.wait(START_S)

    def _begin(self) -> socket.socket:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, __file__, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},  # a library's threads would be missing in the forks
                start_new_session=True,
            )
        return ours

    def _hear(self, limit_s: float) -> bool:
        """Take in one message; False if none comes within `limit_s`."""
        assert self._socket is not None
        if not select.select([self._socket], [], [], limit_s)[0]:
            return False
        message = self._socket.recv(MOST_BYTES)
        assert message, "the process that forks has ended"
        pid, *status = json.loads(message)
        if status:
            (self._statuses[pid],) = status
        else:
            self._started = pid
        return True


def _serve(asked: socket.socket) -> tuple[dict[str, Any], list[int]]:
    """Fork for every request, and tell of every start and end. Returns in the forks only, with the request."""
    woken, waking = os.pipe()
    for fd in (woken, waking):
        os.set_blocking(fd, False)
    signal.set_wakeup_fd(waking)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    running: set[int] = set()
    while True:
        ready, _, _ = select.select([asked, woken], [], [])
        if woken in ready:
            os.read(woken, MOST_BYTES)
            while running and (ended := os.waitpid(-1, os.WNOHANG))[0]:
                running.remove(ended[0])
                asked.send(json.dumps([ended[0], os.waitstatus_to_exitcode(ended[1])]).encode())
        if asked in ready:
            request, fds, _, _ = socket.recv_fds(asked, MOST_BYTES, 3)
            if not request:
                os._exit(0)
            pid = os.fork()
            if not pid:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                for fd in (woken, waking):
                    os.close(fd)
                asked.close()
                return json.loads(request), fds
            running.add(pid)
            asked.send(json.dumps([pid]).encode())
            for fd in fds:
                os.close(fd)


def _become(request: dict[str, Any], stdio: list[int]) -> None:
    """What an interpreter finds when it has been started with `-u`."""
    os.setsid()
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    for number, fd in enumerate(stdio):
        os.dup2(fd, number)
        os.close(fd)
    sys.stdin = sys.__stdin__ = open(0, closefd=False)  # type: ignore[misc]  # noqa: SIM115
    for name, number, errors in (("stdout", 1, "strict"), ("stderr", 2, "backslashreplace")):
        stream = open(number, "w", buffering=1, errors=errors, closefd=False)  # noqa: SIM115
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)


def _run(words: Sequence[str]) -> None:
    """What `python WORDS` runs."""
    first, *others = words
    if first == "-m":
        sys.path[0] = str(Path.cwd())
        sys.argv = others
        runpy.run_module(others[0], run_name="__main__", alter_sys=True)
    elif first == "-c":
        sys.path[0] = ""
        sys.argv = ["-c", *others[1:]]
        main = sys.modules["__main__"] = types.ModuleType("__main__")
        exec(compile(others[0], "<string>", "exec"), main.__dict__)
    else:
        sys.path[0] = str(Path(first).parent.absolute())
        sys.argv = [*words]
        runpy.run_path(first, run_name="__main__")


if __name__ == "__main__":
    for name in IMPORTED:
        importlib.import_module(f"canarm.commands.{name}")
    gc.collect()
    gc.freeze()
    asked_for, descriptors = _serve(socket.socket(fileno=int(sys.argv[1])))
    _become(asked_for, descriptors)
    _run(asked_for["words"])
