"""The dashboard in a real terminal (tmux), over a real socket: a hub in the test sends what a bench would send.

Nothing sleeps: between two looks at the screen the test does the hub's work.
"""

import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from canarm_emulator.hub import Hub, Received
from canarm_tui.synthetic import SyntheticBench

PROGRAM = Path(__file__).with_name("dashboard_program.py")
DEADLINE_S = 60.0
LISTENER_COB_ID = 0x731

pytestmark = pytest.mark.skipif(
    shutil.which("tmux") is None, reason="tmux is not installed; install it to test the dashboard in a real terminal"
)


class Terminal:
    """A tmux server of its own, with one session."""

    def __init__(self, socket: Path, columns: int, rows: int, command: list[str]) -> None:
        self._tmux = ["tmux", "-S", str(socket), "-f", "/dev/null"]
        size = ["-x", str(columns), "-y", str(rows)]
        # One command line, so that the pane is kept also when the program ends at once.
        self._run("new-session", "-d", *size, "sh", ";", "set-option", "-g", "remain-on-exit", "on", ";",
                  "respawn-pane", "-k", *command)  # fmt: skip

    def screen(self) -> str:
        return self._run("capture-pane", "-p")

    def press(self, key: str) -> None:
        self._run("send-keys", key)

    def exit_status(self) -> str:
        """Of the program in the pane; empty while it runs."""
        return self._run("display-message", "-p", "#{pane_dead_status}").strip()

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
            for self._cycle in range(self._cycle + 1, self._cycle + 9):
                for time_ns, frame in self._bench.frames(self._cycle):
                    self.hub.send("bench", time_ns, frame)
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


def wait_for(condition, work, terminal):
    """Work until `condition()` holds."""
    deadline_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline_s, f"not within {DEADLINE_S} s; the screen:\n{terminal.screen()}"
        work()


def test_the_dashboard_shows_a_run_notices_a_loss_comes_back_and_quits(bench, terminal, cell):
    def says(*texts):
        return lambda: all(text in terminal.screen() for text in texts)

    def waiting():
        bench.hub.poll(0.02)

    wait_for(says("● connected", "▶ running", "joint2 error", "cycles/s"), bench.work, terminal)
    wait_for(says("beyond ±1 LSB"), bench.work, terminal)
    assert any(0x2801 <= ord(character) <= 0x28FF for character in terminal.screen())
    assert "unknown 0 │ malformed 0 │ discarded 0 │ dropped samples 0 │ dropped references 0" in terminal.screen()

    bench.hub.close()
    still = Hub("127.0.0.1", 0)
    wait_for(says("✖ lost", "trying again every second", "joint2 error"), lambda: still.poll(0.02), terminal)
    still.close()

    again = FakeBench(cell, bench.port)
    try:
        wait_for(says("● connected", "▶ running"), again.work, terminal)
        terminal.press("q")
        wait_for(lambda: terminal.exit_status() == "0", again.work, terminal)
    finally:
        again.hub.close()
    assert "Traceback" not in terminal.screen()


def test_without_a_bench_the_dashboard_says_what_to_start_and_still_quits(bench, terminal):
    def opening_nothing():
        idle.poll(0.02)

    bench.hub.close()
    idle = Hub("127.0.0.1", 0)
    try:
        wait_for(lambda: "canarm emulator" in terminal.screen(), opening_nothing, terminal)
        terminal.press("q")
        wait_for(lambda: terminal.exit_status() == "0", opening_nothing, terminal)
    finally:
        idle.close()
