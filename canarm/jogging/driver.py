"""Joins a `Jog` to an open bus and the wall clock, and keeps it alive while its user thinks."""

import _thread
import contextlib
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType

from canarm_controller.bus.master import Ask, Silence
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.clock import Clock
from canarm_protocol.errors import BusError
from canarm_protocol.transport.port import BusPort

from .jog import Jog, Work

INTERRUPT_AGAIN_S = 0.5
POLL_S = 0.005
"""How often a wait checks whether a heartbeat is due: a quarter of the shipped cells' heartbeat time."""


class Driver:
    """Sends, receives and waits for `jog` on `port`. While `ask_user` lasts, nothing else may be called."""

    def __init__(self, jog: Jog, port: BusPort) -> None:
        self._jog, self._port = jog, port
        self._lost: BusError | None = None

    def carry_out(self, work: Work) -> list[str]:
        """Run a command to its end. Raises its errors, and `BusError`."""
        jog = self._jog
        jog.now_ns = time.monotonic_ns()
        try:
            ask = next(work)
            while True:
                answer = self._answer(ask)
                jog.now_ns = time.monotonic_ns()
                ask = work.throw(Silence()) if answer is None else work.send(answer)
        except StopIteration as done:
            lines: list[str] = done.value
            return lines
        finally:
            self._flush(())

    def look(self) -> None:
        """Read the frames that have arrived. Raises `JogError` for an alarm, and `BusError`."""
        self._receive(0.0)
        self._flush(())
        self._jog.check()

    def idle(self) -> None:
        """Wait a moment, and keep the bus alive meanwhile. Raises `BusError`."""
        self._receive(POLL_S)
        self._jog.now_ns = time.monotonic_ns()
        self._flush(self._jog.heartbeat_if_due())

    def ask_user(self, read: Callable[[], str]) -> str:
        """The result of `read`; meanwhile heartbeats are sent and frames received. Main thread only.

        Raises what `read` raises, and `BusError` as soon as the bus is lost.
        """
        is_reading = False

        def on_signal(number: int, frame: FrameType | None) -> None:
            if is_reading or self._lost is None:
                raise KeyboardInterrupt

        end = threading.Event()
        pump = threading.Thread(target=self._pump, args=(end,), daemon=True)
        before = signal.signal(signal.SIGINT, on_signal)
        try:
            pump.start()
            try:
                is_reading = True
                return read()
            finally:
                is_reading = False
        finally:
            end.set()
            pump.join()
            signal.signal(signal.SIGINT, before)
            if self._lost is not None:
                raise self._lost

    def end(self) -> None:
        """Leave the cards safe; if the bus is lost, they protect themselves."""
        with contextlib.suppress(BusError):
            self._port.send(self._jog.end())

    def _answer(self, ask: Ask) -> Frame | None:
        self._flush(ask.frames)
        deadline_ns = time.monotonic_ns() + ask.limit_ns
        while (left_s := (deadline_ns - time.monotonic_ns()) * 1e-9) > 0.0:
            answer = self._receive(min(left_s, POLL_S), ask)
            if answer is not None:
                return answer
            if self._jog.clock is Clock.WALL:
                self._flush(self._jog.heartbeat_if_due())
        return None

    def _receive(self, timeout_s: float, ask: Ask | None = None) -> Frame | None:
        """Hand arriving frames to the master; returns the first that answers `ask`."""
        answer = None
        for _, frame in self._port.receive(timeout_s):
            self._jog.receive(frame, time.monotonic_ns())
            if answer is None and ask is not None and ask.is_answer(frame):
                answer = frame
        return answer

    def _flush(self, frames: tuple[Frame, ...] | list[Frame]) -> None:
        gathered, self._jog.outbox = self._jog.outbox, []
        if gathered or frames:
            self._port.send([*gathered, *frames])

    def _pump(self, end: threading.Event) -> None:
        try:
            while not end.is_set():
                self.idle()
        except BusError as error:
            self._lost = error
            # Interrupts a read from the terminal, which would hide the loss until the user types something. A signal
            # just before the read has no effect on it, so it is repeated.
            interrupt_main()
            while not end.wait(INTERRUPT_AGAIN_S):
                interrupt_main()


def interrupt_main() -> None:
    """Interrupt the main thread, as Ctrl-C does."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()
