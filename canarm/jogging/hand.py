"""The cards driven by hand from the dashboard: the same commands and the same master as at the prompt, in a thread."""

import contextlib
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from canarm_controller.errors import ControllerError
from canarm_controller.run.runner import LISTEN_NS
from canarm_protocol.canopen.dictionary import CLOCK_MODE
from canarm_protocol.canopen.frames import Cob
from canarm_protocol.canopen.sdo import SdoAborted
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import DirectionBits, card_nodes
from canarm_protocol.clock import Clock
from canarm_protocol.errors import BusError, CanarmError
from canarm_protocol.shown import named_error
from canarm_protocol.transport.port import BusPort
from canarm_protocol.transport.sdo_session import SdoSession
from canarm_tui.bus.hand import HandState

from .cards import JogError
from .driver import Driver
from .jog import Jog
from .parsing import DIRECTION_NAMES, AllOff, Command, Drive, Parser, Quit, help_lines

LINES = 100
MOST_WAITING = 64
END_S = 2.0


class HandInThread:
    """A `Hand` over a bus of its own, which `open_port` opens. It is closed with the cards left safe."""

    def __init__(self, cell: Cell, open_port: Callable[[], BusPort]) -> None:
        self._cell, self._open_port = cell, open_port
        self._nodes = card_nodes(cell)
        self._parser = Parser(cell, self._nodes)
        self._commands: queue.Queue[list[Command]] = queue.Queue(MOST_WAITING)
        self._undone: deque[list[Command]] = deque()
        """Lines of commands that wait, or are being carried out."""
        self._lines: deque[tuple[bool, str]] = deque(maxlen=LINES)
        self._end = threading.Event()
        self._thread: threading.Thread | None = None
        self._jog: Jog | None = None
        self._is_working = False

    @property
    def state(self) -> HandState:
        """Whether the cards are in hand."""
        if self._thread is None or not self._thread.is_alive():
            return HandState.OFF
        return HandState.BUSY if self._is_working or self._undone else HandState.READY

    @property
    def lines(self) -> Sequence[tuple[bool, str]]:
        """What was said last."""
        return tuple(self._lines)

    @property
    def codes(self) -> Sequence[int]:
        """The code of each joint's output, as commanded last, whether or not it has been carried out."""
        jog = self._jog
        return () if jog is None or self.state is HandState.OFF else tuple(self._asked(jog)[0])

    @property
    def directions(self) -> Sequence[str]:
        """The direction of each joint's output, as commanded, by the words of the command dir."""
        jog = self._jog
        if jog is None or self.state is HandState.OFF:
            return ()
        return tuple(DIRECTION_NAMES.get(each, "off") for each in self._asked(jog)[1])

    def _asked(self, jog: Jog) -> tuple[list[int], list[DirectionBits]]:
        """Codes and directions of `jog` after all commands that wait."""
        codes, directions = list(jog.codes), list(jog.directions)
        for command in (each for commands in tuple(self._undone) for each in commands):
            if isinstance(command, AllOff):
                codes, directions = [0] * len(codes), [DirectionBits.OFF] * len(codes)
            elif isinstance(command, Drive):
                if command.code is not None:
                    codes[command.joint] = command.code
                if command.direction is not None:
                    directions[command.joint] = command.direction
        return codes, directions

    @property
    def help(self) -> str:
        """As the command `help` at the prompt."""
        return "\n".join(help_lines())

    def take(self) -> None:
        """Begin, unless it has begun."""
        if self.state is HandState.OFF:
            self._end = threading.Event()
            self._commands = queue.Queue(MOST_WAITING)
            self._undone.clear()
            self._is_working = True
            self._thread = threading.Thread(target=self._run, args=(self._end,), name="canarm-hand", daemon=True)
            self._thread.start()

    def do(self, commands: str) -> None:
        """Carry out commands; a wrong one is said, and nothing of its line is done."""
        try:
            parsed = self._parser.parse_all(commands)
            if any(isinstance(each, Quit) for each in parsed):
                self.release()
            elif parsed:
                self._undone.append(parsed)
                self._commands.put_nowait(parsed)
        except CanarmError as error:
            self._say(str(error), is_wrong=True)
        except queue.Full:
            self._undone.pop()
            self._say(f"{MOST_WAITING} commands wait already", is_wrong=True)

    def release(self) -> None:
        """Leave the cards safe; a running step ends after its cycle."""
        self._end.set()
        jog = self._jog
        if jog is not None:
            jog.interrupt()

    def close(self) -> None:
        """As `release`, and wait for that."""
        self.release()
        if self._thread is not None:
            self._thread.join(END_S)

    def _say(self, text: str, is_wrong: bool = False) -> None:
        self._lines.extend((is_wrong, line) for line in text.splitlines())

    def _run(self, end: threading.Event) -> None:
        try:
            with self._open_port() as port:
                self._jog = Jog(self._cell, self._nodes, self._clock(port))
                self._drive(Driver(self._jog, port), self._jog, end)
        except SdoAborted as error:
            self._say(f"{self._nodes[0].card.name}: {error}", is_wrong=True)
        except CanarmError as error:
            self._say(str(error), is_wrong=True)
        # In its own thread an unforeseen error would vanish.
        except Exception as error:
            self._say(named_error(error), is_wrong=True)
        finally:
            self._is_working, self._jog = False, None
            self._say("the cards are not in hand")

    def _clock(self, port: BusPort) -> Clock:
        """What drives the cards' time, as they say, asked once nobody else was heard.

        Raises `BusError`, `SdoAborted`, and `JogError` where another controller is.
        """
        end_ns = time.monotonic_ns() + LISTEN_NS
        while (left_ns := end_ns - time.monotonic_ns()) > 0:
            for _, frame in port.receive(left_ns * 1e-9):
                if frame.can_id in (Cob.SYNC, Cob.HEARTBEAT + self._cell.bus.controller_node_id):
                    raise JogError("another controller is on the bus; it has the cards")
        node_id = self._nodes[0].card.node_id
        session = SdoSession(port, Cob.SDO_TO_SERVER + node_id, Cob.SDO_TO_CLIENT + node_id)
        return Clock(int.from_bytes(session.upload(CLOCK_MODE), "little"))

    def _drive(self, driver: Driver, jog: Jog, end: threading.Event) -> None:
        """Carry out commands until the end. Raises `BusError`, and `ControllerError` where the cards are lost."""
        try:
            for line in driver.carry_out(jog.begin(LISTEN_NS)):
                self._say(line)
            while not end.is_set():
                try:
                    self._obey(driver, jog)
                except ControllerError as error:
                    if jog.is_over:
                        raise
                    self._say(str(error), is_wrong=True)
        finally:
            with contextlib.suppress(BusError):
                driver.end()

    def _obey(self, driver: Driver, jog: Jog) -> None:
        """Carry out what waits; with nothing to do, keep the bus alive for a moment. Raises `ControllerError`."""
        try:
            commands = self._commands.get_nowait()
        except queue.Empty:
            self._is_working = False
            driver.idle()
            jog.check()
            return
        self._is_working = True
        try:
            for command in commands:
                for line in driver.carry_out(jog.run(command)):
                    self._say(line)
        finally:
            self._undone.popleft()
