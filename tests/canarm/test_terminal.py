"""The dashboard's terminal: however the program is ended, by a key, a signal or by closing the window, it is as before.

And what the demo ran in the background ends with it, outputs off.
"""

import contextlib
import fcntl
import os
import re
import signal
import struct
import subprocess
import sys
import termios
import threading
from collections.abc import Iterator

import pytest

from canarm.cli import COMMANDS, run

from .conftest import DEADLINE_S, Commands, wait_until
from .test_demo import PRINTING_LAW

pytestmark = pytest.mark.skipif(not hasattr(os, "login_tty"), reason="needs terminals as POSIX has them")
SHOWN = re.compile(rb"\x1b\[\?1049h.*[a-z]{4}", re.DOTALL)
"""The other screen, with words on it."""
LEFT = b"\x1b[?1049l"


class Terminal:
    """`canarm …` with a terminal of its own, as its controlling one."""

    def __init__(self, canarm: Commands, *arguments: str) -> None:
        self._master, slave = os.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 36, 120, 0, 0))
        self._watched = os.dup(slave)
        self.before = termios.tcgetattr(slave)
        self.said = b""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "canarm", *arguments],
            cwd=canarm.folder,
            env=canarm.environment({"TERM": "xterm-256color"}),
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )
        os.close(slave)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while data := os.read(self._master, 65536):
                self.said += data

    @property
    def settings(self) -> list[object]:
        """As `stty` shows them."""
        return termios.tcgetattr(self._watched)

    def wait_for(self, pattern: re.Pattern[bytes]) -> None:
        wait_until(lambda: pattern.search(self.said) or self._process.poll() is not None, pattern.pattern.decode())
        assert self._process.poll() is None, self.said[-2000:]

    def press(self, key: bytes) -> None:
        os.write(self._master, key)

    def send(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def close(self) -> None:
        """Close the window: the kernel sends SIGHUP, and nobody reads or is read any more."""
        master, self._master = self._master, -1
        if master >= 0:
            os.close(self._watched)
            os.close(master)

    def wait(self) -> int:
        return self._process.wait(DEADLINE_S)


@pytest.fixture
def open_terminal(canarm) -> Iterator[object]:
    opened: list[Terminal] = []

    def open_one(*arguments: str) -> Terminal:
        opened.append(Terminal(canarm, *arguments))
        return opened[-1]

    yield open_one
    for terminal in opened:
        with contextlib.suppress(ProcessLookupError):
            terminal.send(signal.SIGKILL)
        terminal.wait()
        terminal.close()


@pytest.mark.parametrize(
    "number", [signal.SIGHUP, *(pytest.param(each, marks=pytest.mark.slow) for each in (signal.SIGTERM, signal.SIGINT))]
)
def test_a_signal_leaves_the_terminal_as_it_was(open_terminal, number: signal.Signals) -> None:
    terminal = open_terminal("tui", "--connect", "127.0.0.1:9")
    terminal.wait_for(SHOWN)
    assert terminal.settings != terminal.before, "the dashboard has not taken the terminal"
    terminal.send(number)
    assert terminal.wait() == 0
    assert terminal.settings == terminal.before
    wait_until(lambda: LEFT in terminal.said, "end of the other screen")


@pytest.mark.parametrize(
    "how", ["Q", *(pytest.param(each, marks=pytest.mark.slow) for each in ("window closed", "Ctrl-C", "SIGHUP"))]
)
def test_who_ends_a_demo_from_its_dashboard_stops_the_robot(canarm, run_folder, open_terminal, how: str) -> None:
    """With paced lockstep, as on every terminal. Torque off: the last commands are zero, and the cards are stopped."""
    demo = open_terminal("demo", "--seconds", "3600", "--law", "pd", "--out", "run")
    demo.wait_for(SHOWN)
    demo.wait_for(re.compile("▶ running".encode()))
    match how:
        case "Ctrl-C":
            demo.press(b"\x03")
        case "Q":
            demo.press(b"Q")
            demo.wait_for(re.compile(b"stop what runs"))
            demo.press(b"y")
        case "SIGHUP":
            demo.send(signal.SIGHUP)
        case _:
            demo.close()
    assert demo.wait() == 1, demo.said[-2000:]
    assert canarm.remaining() == []
    folder = run_folder(canarm.folder / "run").check()
    assert folder.run["summary"]["state"] == "interrupted"
    causes = {"Ctrl-C": "Ctrl-C in the dashboard", "Q": "stopped from the dashboard"}
    assert folder.run["summary"]["reason"].endswith(causes.get(how, "SIGHUP"))
    assert any(event.get("reason") == folder.run["summary"]["reason"] for event in folder.events())
    signals = folder.signals("robot")
    assert signals["joint2.command_a"][-1] == signals["joint3.command_a"][-1] == 0.0
    if how != "window closed":
        assert demo.settings == demo.before
        assert b"INTERRUPTED: konkuk1" in demo.said


@pytest.mark.slow
def test_who_leaves_the_dashboard_of_a_demo_lets_it_go_on_to_its_end(canarm, run_folder, open_terminal) -> None:
    demo = open_terminal("demo", "--seconds", "4", "--law", "pd", "--out", "run")
    demo.wait_for(SHOWN)
    demo.wait_for(re.compile("▶ running".encode()))
    demo.press(b"q")
    demo.wait_for(re.compile(b"the run goes on without the dashboard; Ctrl-C stops it"))
    assert demo.wait() == 0, demo.said[-2000:]
    assert demo.settings == demo.before
    assert run_folder(canarm.folder / "run").check().run["summary"]["ticks"] == 1600


STUCK = """
[[set]]
at = 0.5
[[set.fault]]
tap = "joint2.tachometer"
fault = "stuck"
value = 5.0
"""


@pytest.mark.slow
def test_the_dashboard_of_a_demo_stays_with_the_verdict_and_runs_again_until_it_is_left(
    canarm, run_folder, open_terminal
) -> None:
    (canarm.folder / "laws.py").write_text(PRINTING_LAW)
    (canarm.folder / "stuck.toml").write_text(STUCK)
    options = ("--law", "laws.py:Printing", "--faults", "stuck.toml", "--out", "run")
    demo = open_terminal("demo", "--seconds", "1", "--seed", "5", *options)
    demo.wait_for(SHOWN)
    demo.wait_for(re.compile("✓ DONE: konkuk1, laws.py:Printing".encode()))
    assert run_folder(canarm.folder / "run").run["summary"]["seed"] == 5, "whole before the dashboard is left"
    demo.wait_for(re.compile("◆ detected: tachometer-".encode()))
    assert LEFT not in demo.said
    assert b"xxx" not in demo.said, "what the law prints reaches the terminal"
    demo.press(b"2")
    demo.wait_for(re.compile("▲ fault begins: joint2.tachometer stuck".encode()))
    demo.press(b"r")
    demo.wait_for(re.compile(b"enter runs"))
    demo.press(b"\r")
    demo.wait_for(re.compile("✓ running again: laws.py:Printing on sine, recorded in run/run-2".encode()))
    demo.wait_for(re.compile("✓ DONE: konkuk1.*recorded in run/run-2".encode(), re.DOTALL))
    demo.press(b"q")
    assert demo.wait() == 0, demo.said[-2000:]
    assert demo.settings == demo.before
    summary = demo.said.rpartition(LEFT)[2]
    assert summary.count(b"DONE: konkuk1") == 2
    assert b"recorded in run/run-2" in summary
    again = run_folder(canarm.folder / "run" / "run-2").check().run["summary"]
    assert (again["law"], again["ticks"]) == ("laws.py:Printing", 400)
    run = run_folder(canarm.folder / "run").check().run
    assert (run["summary"]["clock"], run["controller"]["pace"]) == ("sync", "1")


@pytest.mark.parametrize(
    "columns",
    ["1", *(pytest.param(each, marks=pytest.mark.slow) for each in ("0", "x", "-3", "7", "\u00b2", "1" * 5000))],
)
def test_a_terminal_of_one_column_is_no_reason_to_hang_or_fail(
    columns: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setenv("LINES", "1")
    pages = [[], *([name] for name in COMMANDS), ["fault", "inject"], ["fault", "matrix"]]
    for page in pages if columns == "1" else pages[:2]:
        assert run([*page, "--help"]) == 0
        assert len(capsys.readouterr().out) > 20
    for refused in (["nonsense"], ["demo", "--bogus"]):
        assert run(refused) == 2
        assert "should not happen" not in capsys.readouterr().err
    assert run(["check"]) == 0
    assert run(["fault", "list"]) == 0
