"""The dashboard in a real terminal (tmux), over a real socket: a hub in the test sends what a bench would send, or a
real emulator does.

Nothing sleeps: between two looks at the screen the test does the hub's work.
"""

import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from canarm_emulator.serving.hub import Hub
from canarm_emulator.serving.hub_events import Received
from tests.tui.synthetic_bench import SyntheticBench

PROGRAM = Path(__file__).with_name("dashboard_program.py")
DEADLINE_S = 60.0
LISTENER_COB_ID = 0x731

pytestmark = pytest.mark.skipif(
    shutil.which("tmux") is None, reason="tmux is not installed; install it to test the dashboard in a real terminal"
)


class Terminal:
    """A tmux server of its own with one pane, in which the command runs and then its exit status is shown."""

    def __init__(self, socket: Path, columns: int, rows: int, command: list[str]) -> None:
        self._tmux = ["tmux", "-S", str(socket), "-f", "/dev/null"]
        # Where COLUMNS and LINES are set, programs believe them instead of the terminal.
        script = f'unset COLUMNS LINES; {shlex.join(command)}; echo "exit status $?"; exec cat'
        self._run("new-session", "-d", "-x", str(columns), "-y", str(rows), "sh", "-c", script)

    def screen(self) -> str:
        return self._run("capture-pane", "-p")

    def press(self, key: str) -> None:
        self._run("send-keys", key)

    def type(self, text: str) -> None:
        self._run("send-keys", "-l", text)

    def close(self) -> None:
        self._run("kill-server")

    def _run(self, *arguments: str) -> str:
        done = subprocess.run([*self._tmux, *arguments], capture_output=True, text=True, check=True, timeout=DEADLINE_S)
        return done.stdout


class FakeBench:
    """A hub that sends a synthetic run while a listener's heartbeat is seen."""

    def __init__(self, cell, port: int = 0) -> None:
        self.hub = Hub("127.0.0.1", port)
        self.port = self.hub.address[1]
        self._bench = SyntheticBench(cell)
        self._cycle = 0
        self._listened = False

    def work(self) -> None:
        """Some of the hub's work; returns after at most 20 ms."""
        for event in self.hub.poll(0.02):
            if isinstance(event, Received) and event.frame.can_id == LISTENER_COB_ID:
                self._listened = True
        if self._listened:
            for cycle in range(self._cycle, self._cycle + 8):
                for time_ns, frame in self._bench.frames(cycle):
                    self.hub.send("bench", time_ns, frame)
            self._cycle += 8
        self.hub.flush()


@pytest.fixture
def bench(cell):
    bench = FakeBench(cell)
    yield bench
    bench.hub.close()


@pytest.fixture
def terminal(bench, tmp_path):
    terminal = Terminal(tmp_path / "tmux", 120, 36, [sys.executable, str(PROGRAM), str(bench.port)])
    yield terminal
    terminal.close()


def wait_for(terminal, work, *texts):
    """Work until the screen shows all `texts`, however it breaks lines; return the screen."""
    deadline_s = time.monotonic() + DEADLINE_S
    while True:
        screen = terminal.screen()
        if all(text in " ".join(screen.split()) for text in texts):
            return screen
        assert time.monotonic() < deadline_s, f"{texts} not within {DEADLINE_S} s; the screen:\n{screen}"
        work()


def wait_until_gone(terminal, work, text):
    """Work until the screen no longer shows `text`."""
    deadline_s = time.monotonic() + DEADLINE_S
    while text in (screen := terminal.screen()):
        assert time.monotonic() < deadline_s, f"{text!r} still there after {DEADLINE_S} s; the screen:\n{screen}"
        work()


@pytest.fixture
def idle():
    """Work that lets time pass and sends nothing."""
    hub = Hub("127.0.0.1", 0)
    yield lambda: hub.poll(0.02)
    hub.close()


def test_the_dashboard_shows_a_run_notices_a_loss_comes_back_and_quits(bench, terminal, cell, idle):
    wait_for(terminal, bench.work, "● connected", "▶ running", "joint2 error", "cycles/s")
    screen = wait_for(terminal, bench.work, "beyond ±1 LSB")
    assert any(0x2801 <= ord(character) <= 0x28FF for character in screen)
    assert "dropped samples 0 │ dropped references 0 │ unknown 0 │ malformed 0 │ discarded 0" in screen

    bench.hub.close()
    wait_for(terminal, idle, "✖ lost", "trying again every second", "joint2 error")

    again = FakeBench(cell, bench.port)
    try:
        wait_for(terminal, again.work, "● connected", "▶ running")
        terminal.press("q")
        screen = wait_for(terminal, again.work, "exit status")
    finally:
        again.hub.close()
    assert screen.strip() == "exit status 0"


def test_without_a_bench_the_dashboard_says_what_to_start_and_still_quits(bench, terminal, idle):
    bench.hub.close()
    wait_for(terminal, idle, "✖ not connected", "start one with: canarm emulator")
    terminal.press("q")
    assert wait_for(terminal, idle, "exit status").strip() == "exit status 0"


@pytest.fixture
def emulator_port(tmp_path):
    """The port of an emulator, a process of its own; without a controller its time stands still."""
    command = [sys.executable, "-m", "canarm", "emulator", "--clock", "sync", "--serve", "127.0.0.1:0"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as run:
        yield int(re.search(r"port=(\d+)", run.stdout.readline())[1])
        run.terminate()


def test_a_fault_is_injected_with_keys_into_a_real_emulator_and_acts_until_it_is_cleared(emulator_port, tmp_path, idle):
    terminal = Terminal(tmp_path / "tmux", 80, 24, [sys.executable, str(PROGRAM), str(emulator_port)])
    try:
        wait_for(terminal, idle, "● connected")
        terminal.press("f")
        wait_for(terminal, idle, "where?", "joint2.dac.code")
        terminal.type("2 tacho")
        # The name of the first tap is gone as soon as what was typed counts.
        wait_until_gone(terminal, idle, "joint2.dac.code")
        terminal.press("Enter")
        wait_for(terminal, idle, "joint2.tachometer: which fault?")
        terminal.type("stuck")
        wait_until_gone(terminal, idle, "noise")
        terminal.press("Enter")
        wait_for(terminal, idle, "enter injects", "0 to 5 V")
        # Textual may put keys that come faster than a hand types them into another order.
        terminal.type("99")
        wait_for(terminal, idle, "value 99 0 to 5 V")
        terminal.press("Enter")
        wait_for(terminal, idle, "99: must be a number from 0 to 5 V")
        terminal.press("BSpace")
        wait_for(terminal, idle, "value 9 0 to 5 V")
        terminal.press("BSpace")
        wait_for(terminal, idle, "value 0 to 5 V")
        terminal.type("2.5")
        wait_for(terminal, idle, "value 2.5 0 to 5 V")
        terminal.press("Enter")
        wait_for(terminal, idle, "accepted 'joint2.tachometer stuck'")
        wait_for(terminal, idle, "▲ 1 fault acts", "▲ joint2.tachometer stuck, since", "begun so far 1")
        terminal.press("x")
        wait_for(terminal, idle, "enter clears")
        terminal.press("Enter")
        wait_for(terminal, idle, "no fault acts", "fault ends: joint2.tachometer stuck")
        terminal.press("e")
        wait_for(terminal, idle, "■ EMERGENCY STOP")
        terminal.press("q")
        assert wait_for(terminal, idle, "exit status").strip() == "exit status 0"
    finally:
        terminal.close()
