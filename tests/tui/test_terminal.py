"""A terminal that goes while a screen is drawn on it: its window is closed, the connection to it is lost."""

import os
import subprocess
import sys
import threading
import time

import pytest

from canarm_emulator.serving.hub import Hub
from canarm_protocol.canopen.frames import Frame
from canarm_tui.terminal import Outliving

DEADLINE_S = 60.0
AT_A_TERMINAL = """
import fcntl, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
from canarm.cli import main
main(sys.argv[1:])
"""
"""A program whose controlling terminal is its stdin: when that goes, it is told by SIGHUP."""


class Gone:
    """The stream of a terminal that is not there any more."""

    encoding = "utf-8"

    def write(self, text):
        raise OSError(5, "Input/output error")

    def flush(self):
        raise OSError(5, "Input/output error")


def test_what_is_written_to_a_terminal_that_is_gone_is_dropped():
    stream = Outliving(Gone())
    assert stream.write("text") == 4
    stream.flush()
    assert stream.encoding == "utf-8"


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")
def test_a_busy_screen_ends_when_its_window_is_closed():
    """400 frames a second are drawn while the terminal goes; nothing waits for it."""
    hub, is_over = Hub("127.0.0.1", 0), threading.Event()

    def send() -> None:
        count = 0
        while not is_over.is_set():
            hub.poll(0.02)
            for _ in range(8):
                count += 1
                hub.send("can0", count * 2_500_000, Frame(0x100 + count % 50, count.to_bytes(8, "little")))
            hub.flush()

    sender = threading.Thread(target=send)
    sender.start()
    ours, theirs = os.openpty()
    command = [sys.executable, "-c", AT_A_TERMINAL, "monitor", "--connect", f"127.0.0.1:{hub.address[1]}"]
    try:
        process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True)
        os.close(theirs)
        seen, deadline_s = b"", time.monotonic() + DEADLINE_S
        while b"identifiers" not in seen:
            assert time.monotonic() < deadline_s, seen[-2000:]
            seen = (seen + os.read(ours, 65536))[-100_000:]
        os.close(ours)
        process.wait(DEADLINE_S)
    finally:
        process.kill()
        is_over.set()
        sender.join()
        hub.close()
