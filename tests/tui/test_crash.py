"""A screen that breaks: the terminal is as before, one line says what happened, the traceback is in a file."""

import os
import re
import select
import subprocess
import sys
import time

import pytest

from canarm_tui import crash
from canarm_tui.errors import BrokenError

DEADLINE_S = 60.0
BROKEN = """
import os, sys
from canarm.cli import _set_up_logging
from canarm_protocol.errors import CanarmError
from canarm_tui.steady import SteadyApp
from canarm_tui.terminal import run_app

class Broken(SteadyApp):
    TITLE = "canarm"

    def on_key(self, event):
        value = "a value of no concern"
        raise RuntimeError("a key too many")

_set_up_logging()
try:
    run_app(Broken())
except CanarmError as error:
    print(f"canarm: {error}", file=sys.stderr)
    sys.exit(error.exit_status)
"""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")


def read_until(terminal, seen, *texts):
    deadline_s = time.monotonic() + DEADLINE_S
    while not all(text in seen for text in texts):
        assert time.monotonic() < deadline_s, seen[-2000:]
        if select.select([terminal], [], [], 1.0)[0]:
            seen += os.read(terminal, 65536)
    return seen


def broken_program(folder, **environment):
    """Exit status, and what was on the terminal after the application's screen."""
    import termios

    ours, theirs = os.openpty()
    before = termios.tcgetattr(theirs)
    variables = {**os.environ, "TMPDIR": str(folder), "TERM": "xterm", **environment}
    process = subprocess.Popen(
        [sys.executable, "-c", BROKEN], stdin=theirs, stdout=theirs, stderr=theirs, env=variables
    )
    try:
        read_until(ours, b"", b"\x1b[?1049h", b"\x1b[?2004h")
        os.write(ours, b"x")
        seen = read_until(ours, b"", b"\x1b[?1049l", b"traceback is in", b".log")
        status = process.wait(DEADLINE_S)
        assert termios.tcgetattr(theirs) == before
    finally:
        process.kill()
        os.close(ours)
        os.close(theirs)
    return status, seen.rpartition(b"\x1b[?1049l")[2].decode()


def test_one_line_is_on_the_terminal_and_the_traceback_in_the_file_that_it_names(tmp_path):
    status, seen = broken_program(tmp_path)
    assert status == 1
    assert "canarm broke, which should not happen: RuntimeError: a key too many; its traceback is in " in seen
    assert "Traceback" not in seen
    assert "of no concern" not in seen
    (file,) = tmp_path.glob("canarm-*.log")
    assert str(file) in seen
    text = file.read_text()
    assert text.startswith("Traceback")
    assert "in on_key" in text
    assert text.endswith("RuntimeError: a key too many\n")


def test_under_debug_the_traceback_is_on_the_terminal_too(tmp_path):
    _, seen = broken_program(tmp_path, CANARM_LOG="debug")
    assert "Traceback (most recent call last)" in seen


def test_what_was_typed_into_a_screen_that_breaks_does_not_reach_the_shell(monkeypatch):
    import termios
    import tty

    ours, theirs = os.openpty()
    with os.fdopen(theirs) as stdin:
        monkeypatch.setattr(sys, "__stdin__", stdin)
        before = termios.tcgetattr(theirs)

        def break_down():
            with crash.terminal_as_before():
                tty.setraw(theirs)
                os.write(ours, b"reboot\n")
                assert select.select([theirs], [], [], DEADLINE_S)[0]
                raise BrokenError("broken")

        with pytest.raises(BrokenError):
            break_down()
        assert termios.tcgetattr(theirs) == before
        assert not select.select([theirs], [], [], 0)[0]
    os.close(ours)


def test_a_terminal_that_textual_has_left_behind_gets_its_first_screen_back(monkeypatch, tmp_path):
    ours, theirs = os.openpty()
    with os.fdopen(theirs) as stdin, (tmp_path / "seen").open("w") as stderr:
        monkeypatch.setattr(sys, "__stdin__", stdin)
        monkeypatch.setattr(sys, "__stderr__", stderr)
        with pytest.raises(OSError, match="gone"), crash.terminal_as_before():
            raise OSError("gone")
    os.close(ours)
    assert set(re.findall(r"\[\?(?:1049l|25h|1003l)", (tmp_path / "seen").read_text())) == {
        "[?1049l",
        "[?25h",
        "[?1003l",
    }


def test_where_no_file_can_be_written_the_line_says_so(monkeypatch):
    def refuse(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(crash.tempfile, "NamedTemporaryFile", refuse)
    assert "no traceback, No space left on device" in str(crash.broken("canarm", ValueError("bad")))
