"""Progress of a campaign on stderr: a bar on a terminal, else a line per tenth. Only here is the wall clock read."""

import sys
import time

from canarm_protocol.shown import printable_lines

BAR = 30
"""Characters of the bar."""
TENTHS = 10


class Progress:
    """Called after every run; see `run_campaign`. `jobs` runs go on at a time.

    The first run of each process takes longer, for it starts the process; so the time that is left is reckoned from
    those after them, as soon as there are as many.
    """

    def __init__(self, jobs: int = 1) -> None:
        self._jobs = jobs
        self._is_terminal = sys.stderr is not None and sys.stderr.isatty()
        self._begun_s: float | None = None
        self._before = 0
        self._warm: tuple[float, int] | None = None
        """When every process had done a run, and how many were done then."""
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
        if self._warm is None and done >= self._before + self._jobs:
            self._warm = now_s, done
        if sys.stderr is None or done <= self._before:
            return
        since_s, since = self._begun_s, self._before
        if self._warm is not None and done >= self._warm[1] + self._jobs:
            since_s, since = self._warm
        left_s = (now_s - since_s) * (total - done) / (done - since)
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
