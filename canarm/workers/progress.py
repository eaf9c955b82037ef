"""Progress of a campaign on stderr: a bar on a terminal, else a line per tenth. Only here is the wall clock read."""

import sys
import time

from canarm_protocol.shown import printable_lines

BAR = 30
"""Characters of the bar."""
TENTHS = 10


class Progress:
    """Called after every run; see `run_campaign`."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr is not None and sys.stderr.isatty()
        self._begun_s: float | None = None
        self._before = 0
        self._told = 0

    def note(self, text: str) -> None:
        """Show `text` on its own line."""
        if sys.stderr is not None:
            print(f"canarm: {printable_lines(text)}", file=sys.stderr, flush=True)

    def __call__(self, done: int, total: int) -> None:
        """`done` of `total` runs have ended; first told before the first of them begins: those were done before."""
        now_s = time.monotonic()
        if self._begun_s is None:
            self._begun_s, self._before = now_s, done
        if sys.stderr is None or done <= self._before:
            return
        left_s = (now_s - self._begun_s) * (total - done) / (done - self._before)
        if self._is_terminal:
            bar = "#" * (BAR * done // total)
            end = "\n" if done == total else ""
            print(f"\r{bar:.<{BAR}} {done}/{total} runs, {left_s:.0f} s left ", end=end, file=sys.stderr, flush=True)
        elif (tenth := TENTHS * done // total) > self._told:
            self._told = tenth
            self.note(f"{done * 100 // total} % ({done} of {total} runs), {left_s:.0f} s left")

    def leave(self) -> None:
        """End the line of the bar, which then stays."""
        if self._is_terminal and self._begun_s is not None:
            print(file=sys.stderr, flush=True)
