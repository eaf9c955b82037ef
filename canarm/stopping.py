"""Ending a process on request: signals, a vanished parent, a time limit, user code that does not return."""

import contextlib
import os
import signal
import stat
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType

from canarm_protocol.shown import printable

STUCK_S = 6
"""Seconds after which a loop that does not ask counts as stuck: less than a parent waits for the end."""
HANGUP: signal.Signals | None = getattr(signal, "SIGHUP", None)
"""Sent by a closing terminal; None if the system has no such signal."""
_HELD_BACK = (signal.SIGINT, signal.SIGTERM, *(() if HANGUP is None else (HANGUP,)))
MOST_WORDS = 200
"""Bytes of what a parent says about the end that it asks for."""
AGAIN_S = 0.5
"""A signal this soon after the first is the same one: timeout(1) sends it to the process and to its group."""


class StopRequest:
    """Tells a running loop whether it should end, and why. Takes over SIGINT, SIGTERM and SIGHUP.

    A loop that runs user code passes `place`, which tells how far it has come. Then the process ends at once, with
    status 1, on a second SIGINT or SIGTERM, or if the loop does not ask for `STUCK_S` although it should end, or for
    `patience_s` where nobody watches it (`with_parent`).
    """

    def __init__(
        self,
        seconds: float | None = None,
        with_parent: bool = False,
        place: Callable[[], str] | None = None,
        parents_words: int | None = None,
        patience_s: float = STUCK_S,
    ) -> None:
        self._patience_s = max(patience_s, STUCK_S)
        self._reason: str | None = None
        self._deadline = None if seconds is None else time.monotonic() + seconds
        self._parent = os.getppid() if with_parent else None
        self._place, self._words = place, parents_words
        self._signalled_s: float | None = None
        self._is_waiting = False
        self._questions = 0
        self._watch: threading.Thread | None = None
        self._is_over = threading.Event()
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            # A signal that nohup ignores stays ignored.
            if number is not None and not (name == "SIGHUP" and signal.getsignal(number) is signal.SIG_IGN):
                signal.signal(number, self._on_signal)
        if with_parent:
            self._start_watch()

    def reason(self) -> str | None:
        """The reason to stop, or None."""
        self._questions += 1
        if self._reason is None:
            if self._parent is not None and os.getppid() != self._parent:
                self._reason = "the process that started this one is gone"
            elif self._deadline is not None and time.monotonic() > self._deadline:
                self._reason = "time is up"
        return self._reason

    def is_due(self) -> bool:
        """Whether to stop."""
        return self.reason() is not None

    def ask(self, reason: str) -> None:
        """Request the end from inside the process; an earlier reason is kept."""
        self._reason = self._reason or reason

    @contextlib.contextmanager
    def interrupting(self) -> Iterator[None]:
        """A signal ends what is done in here at once: it waits for others, and asks nobody whether to stop.

        Raises `KeyboardInterrupt`; `reason` is as ever.
        """
        self._is_waiting = True
        try:
            if self._reason is not None:
                raise KeyboardInterrupt
            yield
        finally:
            self._is_waiting = False

    def is_over(self) -> None:
        """The loop has ended and will not ask again."""
        self._is_over.set()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.ask(self._said_by_parent(number) or signal.Signals(number).name)
        now_s = time.monotonic()
        if self._signalled_s is None:
            self._signalled_s = now_s
            self._start_watch()
            if self._is_waiting:
                raise KeyboardInterrupt
        # A closing terminal sends SIGHUP more than once.
        elif (
            self._place is not None
            and number in (signal.SIGINT, signal.SIGTERM)
            and now_s - self._signalled_s > AGAIN_S
        ):
            _end_now("interrupted twice")

    def _said_by_parent(self, number: int) -> str:
        """Why the parent asks for the end: its SIGTERM may pass on a Ctrl-C, or a dashboard that was left."""
        if self._words is None or number != signal.SIGTERM:
            return ""
        try:
            return printable(os.read(self._words, MOST_WORDS).decode(errors="replace").strip())
        except OSError:
            return ""

    def _start_watch(self) -> None:
        if self._place is not None and self._watch is None:
            self._watch = threading.Thread(target=self._watch_questions, args=(self._place,), daemon=True)
            self._watch.start()

    def _watch_questions(self, place: Callable[[], str]) -> None:
        """Count seconds in which the loop does not ask, without a clock: a suspended machine is not stuck."""
        asked, silent_s = -1, 0
        while silent_s < (self._patience_s if self._signalled_s is None else STUCK_S):
            if self._is_over.wait(1.0):
                return
            # Before the first question other limits apply, unless the end was requested.
            if self._questions != asked or (not asked and self._signalled_s is None):
                asked, silent_s = self._questions, 0
            else:
                silent_s += 1
        _end_now(f"{place()} for {silent_s} s (does the law loop for ever? --sync-timeout sets how long it may take)")


@contextlib.contextmanager
def signals_held_back() -> Iterator[None]:
    """SIGINT, SIGTERM and SIGHUP are handled afterwards: nothing that is begun in here is left half done.

    A mask does not do that: they reach other threads, and Python's handlers run in this one all the same, within what
    libraries do around a fork.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []
    before = {number: signal.getsignal(number) for number in _HELD_BACK}
    before = {number: handler for number, handler in before.items() if callable(handler)}
    for number in before:
        signal.signal(number, lambda number, frame: held.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for each in held:
            signal.raise_signal(each)


def parents_words(with_parent: bool) -> int | None:
    """A descriptor of what the parent will say about the end, which comes through stdin; None without such a parent.

    Call it before any code of a user runs, which then finds an empty stdin.
    """
    if not with_parent or os.name != "posix":
        return None
    with contextlib.suppress(OSError):
        return _taken_stdin() if stat.S_ISFIFO(os.fstat(0).st_mode) else None
    return None


def _taken_stdin() -> int:
    words, nothing = os.dup(0), os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.set_blocking(words, False)
    return words


def interrupt_on_terminate() -> None:
    """Let SIGINT, SIGTERM and SIGHUP raise `KeyboardInterrupt`, for a command that must clean up.

    `cause_of` tells which it was. One within `AGAIN_S` of the last changes nothing: the clean-up goes on.
    """
    last_s = -AGAIN_S

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal last_s
        before_s, last_s = last_s, time.monotonic()
        if last_s - before_s >= AGAIN_S:
            raise KeyboardInterrupt(signal.Signals(number).name)

    signal.signal(signal.SIGTERM, interrupt)
    for number in filter(None, (signal.SIGINT, HANGUP)):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, interrupt)


@contextlib.contextmanager
def signals_as_before() -> Iterator[None]:
    """An event loop puts its own handlers in the place of ours; afterwards ours are back."""
    before = {number: signal.getsignal(number) for number in _HELD_BACK}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)


def cause_of(interrupt: KeyboardInterrupt) -> str:
    """What has caused an interrupt, in a few words: Python's own says nothing and is a Ctrl-C."""
    return str(interrupt) or signal.SIGINT.name


def ignore_hangups() -> None:
    """Ignore SIGHUP from now on: a closing terminal sends it more than once, and the end must not be interrupted."""
    if HANGUP is not None:
        signal.signal(HANGUP, signal.SIG_IGN)


def _end_now(why: str) -> None:
    """End the process whatever its other threads do, without the interpreter's clean-up."""
    text = f"canarm: {why}: ended without a safe stop; the cards protect themselves\n"
    try:
        os.write(2, text.encode(errors="replace"))
    finally:
        os._exit(1)
