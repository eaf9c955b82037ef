"""Real processes: starting them, waiting for what they say, reading what they leave, and leaving none behind.

Nothing sleeps blindly: every wait is for a line, an end or a condition, and has a deadline.
"""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from canarm_protocol.cell.cell_file import shipped_cells
from canarm_protocol.runs.run_folder import LOG_START_S
from tests.starter import Forked, Starter

DEADLINE_S = 60.0 * float(os.environ.get("PATIENCE", "1"))
"""Far longer than anything takes: a busy machine must not fail a test. PATIENCE=10 is for emulated machines."""
PATIENT = {
    "heartbeat_timeout_ms = 100 ": "heartbeat_timeout_ms = 2000 ",
    "missing_cycles = 16 ": "missing_cycles = 400 ",
    "max_position_step_deg = 8.0 ": "max_position_step_deg = 200.0 ",
}
"""What is changed in konkuk1 for runs on the wall clock: a busy machine must not look like a broken robot."""
MARKER = "PROCESS_OF_TEST"
"""Environment variable by which the processes of one test, grandchildren included, are found again."""


def wait_until(condition: Callable[[], Any], what: str, deadline_s: float = DEADLINE_S) -> Any:
    """The first true value of `condition`."""
    limit = time.monotonic() + deadline_s
    pause = threading.Event()
    while not (value := condition()):
        assert time.monotonic() < limit, f"{what}: not within {deadline_s:g} s"
        pause.wait(0.01)
    return value


class Process:
    """A program that runs, the lines it has written so far, and the signals one can send it."""

    def __init__(self, command: list[str], process: "subprocess.Popen[str] | Forked") -> None:
        self.command = shlex.join(command)
        self._popen = process
        self.stdout: list[str] = []
        self.stderr: list[str] = []
        self._news = threading.Condition()
        self._readers = [
            threading.Thread(target=self._read, args=(stream, lines), daemon=True)
            for stream, lines in ((self._popen.stdout, self.stdout), (self._popen.stderr, self.stderr))
        ]
        for reader in self._readers:
            reader.start()

    def _read(self, stream: Any, lines: list[str]) -> None:
        for line in stream:
            with self._news:
                lines.append(line.rstrip("\n"))
                self._news.notify_all()
        stream.close()
        with self._news:
            self._news.notify_all()

    @property
    def pid(self) -> int:
        return self._popen.pid

    @property
    def is_running(self) -> bool:
        return self._popen.poll() is None

    def wait_for(self, pattern: str) -> re.Match[str]:
        """The first match in a line of either output, past or to come."""
        limit = time.monotonic() + DEADLINE_S
        with self._news:
            while True:
                for line in (*self.stdout, *self.stderr):
                    if found := re.search(pattern, line):
                        return found
                assert any(reader.is_alive() for reader in self._readers), f"{pattern!r} never came\n{self}"
                assert self._news.wait(limit - time.monotonic()), f"{pattern!r} not within {DEADLINE_S} s\n{self}"

    def wait(self) -> int:
        """The exit status, once the process has ended and everything it wrote is read."""
        try:
            status = self._popen.wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            pytest.fail(f"still running after {DEADLINE_S:g} s\n{self}")
        for reader in self._readers:
            reader.join(DEADLINE_S)
        return status

    def send(self, number: signal.Signals) -> None:
        os.kill(self._popen.pid, number)

    @property
    def json(self) -> dict[str, Any]:
        """The last line of stdout."""
        return dict(json.loads(self.stdout[-1]))

    @property
    def complaint(self) -> str:
        """What stderr says, which must be no traceback."""
        text = "\n".join(self.stderr)
        assert "Traceback" not in text, text
        return text

    def __str__(self) -> str:
        return "\n".join(["$ " + self.command, *self.stdout, "-- stderr", *self.stderr])


class Commands:
    """Starts `canarm …` in a folder of the test's own. Ports are free ones; no process outlives its test."""

    def __init__(self, folder: Path, starter: Starter | None) -> None:
        self.folder = folder
        self._starter = starter
        self._processes: list[Process] = []
        self._marker = uuid.uuid4().hex

    def run(self, *command: str, env: dict[str, str] | None = None, **options: Any) -> Process:
        """Any program, started."""
        popen = subprocess.Popen(
            command,
            cwd=self.folder,
            env=self.environment(env),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            **{"stdin": subprocess.DEVNULL, **options},
        )
        return self._kept(Process(list(command), popen))

    def __call__(self, *arguments: str, env: dict[str, str] | None = None, **options: Any) -> Process:
        """`canarm …`, started; as a fork, unless what is asked for is an interpreter's business."""
        words = ("-m", "canarm", *arguments)
        if options or any(not name.startswith("CANARM_") for name in env or ()):
            return self.run(sys.executable, *words, env=env, **options)
        return self.python(*words, env=env)

    def python(self, *words: str, env: dict[str, str] | None = None, stdin: int | None = None) -> Process:
        """`python …`, started; a fork wherever it can be."""
        command = [sys.executable, *words]
        if self._starter is None:
            return self.run(*command, env=env, **({} if stdin is None else {"stdin": stdin}))
        fork = self._starter.start(words, self.folder, self.environment(env), (stdin, None, None))
        return self._kept(Process(command, fork))

    def piped(self, text: str, *arguments: str) -> Process:
        """`canarm …`, which reads this text from a pipe."""
        reading, writing = os.pipe()
        process = self.python("-m", "canarm", *arguments, stdin=reading)
        os.close(reading)
        with os.fdopen(writing, "w") as pipe:
            pipe.write(text)
        return process

    def at_terminal(self, terminal: int, *arguments: str) -> "subprocess.Popen[bytes] | Forked":
        """`canarm …` with this terminal for stdin, stdout and stderr."""
        words = ("-m", "canarm", *arguments)
        environment = {**os.environ, "TERM": "dumb"}
        if self._starter is not None:
            return self._starter.start(words, self.folder, environment, (terminal, terminal, terminal))
        return subprocess.Popen(
            [sys.executable, *words],
            cwd=self.folder,
            env=environment,
            stdin=terminal,
            stdout=terminal,
            stderr=terminal,
        )

    def environment(self, more: dict[str, str] | None = None) -> dict[str, str]:
        """Ours, with the mark of this test, and with `more`."""
        inherited = {name: value for name, value in os.environ.items() if not name.startswith("CANARM_")}
        return {**inherited, "COLUMNS": "100", "PYTHONUNBUFFERED": "1", MARKER: self._marker, **(more or {})}

    def _kept(self, process: Process) -> Process:
        self._processes.append(process)
        return process

    def write_cell(self, name: str, changes: dict[str, str]) -> str:
        """A cell file: konkuk1 with texts replaced. Returns its name."""
        text = shipped_cells()["konkuk1"]
        for old, new in changes.items():
            assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the cell"
            text = text.replace(old, new)
        (self.folder / name).write_text(text)
        return name

    def for_clock(self, clock: str) -> list[str]:
        """`--clock`, and a cell that bears the delays of a busy machine where they can hurt."""
        return ["--clock", clock, *(["--cell", self.write_cell("patient.toml", PATIENT)] if clock == "wall" else [])]

    def emulator(self, clock: str, *arguments: str) -> Process:
        """An emulator that offers its buses; its port is in `port`."""
        process = self("emulator", "--serve", "127.0.0.1:0", *self.for_clock(clock), *arguments)
        process.port = int(process.wait_for(r"^bench .*port=(\d+)\b").group(1))  # type: ignore[attr-defined]
        return process

    def controller(self, emulator: Process, clock: str, *arguments: str) -> Process:
        """A controller on the buses of `emulator`, which reports its progress."""
        address = f"127.0.0.1:{emulator.port}"  # type: ignore[attr-defined]
        return self("controller", "--connect", address, *self.for_clock(clock), "--progress", "--json", *arguments)

    def remaining(self) -> list[int]:
        """Process IDs of the started processes, and (Linux) of all that carry this test's mark."""
        found = [process.pid for process in self._processes if process.is_running]
        mark = f"{MARKER}={self._marker}".encode()
        for path in Path("/proc").glob("[0-9]*/environ"):
            try:
                if mark in path.read_bytes() and int(path.parent.name) not in found:
                    found.append(int(path.parent.name))
            except OSError:
                continue
        return found

    def close(self) -> None:
        for pid in self.remaining():
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        for process in self._processes:
            process.wait()
        wait_until(lambda: not self.remaining(), "end of all processes")


class RunFolder:
    """A run folder, read with everybody's tools: json, python-can, numpy."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def run(self) -> dict[str, Any]:
        return dict(json.loads((self.path / "run.json").read_text()))

    def frames(self) -> list[can.Message]:
        """Every frame of can0.log, with its time since power-on."""
        with can.LogReader(self.path / "can0.log") as reader:
            messages = list(reader)
        for message in messages:
            message.timestamp -= LOG_START_S
        return messages

    def signals(self, name: str) -> dict[str, Any]:
        """The columns of a CSV file; every row has every column."""
        header, *rows = (self.path / "signals" / f"{name}.csv").read_text().splitlines()
        table = [[float(value) for value in row.split(",")] for row in rows]
        columns = header.split(",")
        assert {len(row) for row in table} <= {len(columns)}
        return dict(zip(columns, np.array(table).reshape(-1, len(columns)).T, strict=True))

    def events(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in (self.path / "events.jsonl").read_text().splitlines()]

    def check(self) -> "RunFolder":
        """Everything that is there can be read."""
        assert self.run
        if (self.path / "can0.log").exists():
            self.frames()
            self.signals("robot")
        if (self.path / "signals" / "controller.csv").exists():
            self.signals("controller")
        self.events()
        return self


@pytest.fixture
def canarm(tmp_path, starter) -> Iterator[Commands]:
    commands = Commands(tmp_path, starter)
    yield commands
    commands.close()


@pytest.fixture(scope="module")
def canarm_of_module(tmp_path_factory, starter) -> Iterator[Commands]:
    """As `canarm`, for processes of which several tests ask something."""
    commands = Commands(tmp_path_factory.mktemp("module"), starter)
    yield commands
    commands.close()


@pytest.fixture(scope="session")
def run_folder() -> type[RunFolder]:
    return RunFolder


@pytest.fixture
def until() -> Callable[..., Any]:
    return wait_until
