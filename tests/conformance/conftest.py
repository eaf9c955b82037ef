"""Links between a stock CANopen master and the emulated cards: one suite of tests runs over each of them.

A link is python-canopen's `Network` on a python-can bus: in this process in virtual time, to a real emulator over the
virtual bus (our driver and the stock socketcand one), over a serial adapter, over SocketCAN where CANARM_SOCKETCAN
names two interfaces, one for each clock. Nothing sleeps: `Link.until` lets time pass until a condition holds, as it
passes there.
"""

import io
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import canopen
import pytest

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.dictionary import eds_text
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.cell_file import load_cell, shipped_cells
from canarm_protocol.clock import Clock

CELL = load_cell("konkuk1")
NODE_IDS = [card.node_id for card in CELL.card]
SILENT = {f"{joint}.noise_lsb": "0" for joint in CELL.joint_names}
PATIENCE = float(os.environ.get("PATIENCE", "1"))
DEADLINE_S = 60.0 * PATIENCE
"""Far longer than anything takes: a busy machine must not fail a test. PATIENCE=10 is for emulated machines."""
BOOT_MS = min(round(10 * PATIENCE**2), 1000)
"""What a card takes to boot on the wall clock: longer than the machine takes from a master's send to its wait."""
MILLISECOND = 1_000_000
LONGEST_MS = 10_000
LINKS = (
    "in-process",
    "canarm-sync",
    "canarm-wall",
    "socketcand-sync",
    "slcan-sync",
    "socketcan-sync",
    "socketcan-wall",
)
RESET_NODE, RESET_COMMUNICATION = 0x81, 0x82
SYNC, TIME = 0x080, 0x100


class InProcessBus(can.BusABC):
    """The bench as a python-can bus: what is sent is answered before `send` returns, stamped with virtual time."""

    def __init__(self, bench: FaultBench, deliver: Callable[[can.Message], None]) -> None:
        self.bench, self._deliver = bench, deliver
        super().__init__(channel="bench")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        frame = Frame(msg.arbitration_id, bytes(msg.data), msg.is_extended_id, msg.is_remote_frame)
        self.bench.receive(frame, self)
        self.hand_over()

    def hand_over(self) -> None:
        records, self.bench.records = self.bench.records, []
        for time_ns, frame, origin in records:
            if origin is None:
                self._deliver(
                    can.Message(
                        timestamp=time_ns * 1e-9,
                        arbitration_id=frame.can_id,
                        is_extended_id=frame.is_extended,
                        is_remote_frame=frame.is_remote,
                        data=frame.data,
                    )
                )

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return None, True


class Link:
    """A master on the robot's bus. `heard` is what came from the bus since the test began."""

    def __init__(self, clock: Clock, carries_remote_frames: bool = True) -> None:
        self.clock, self.carries_remote_frames = clock, carries_remote_frames
        self.heard: list[can.Message] = []
        self.network = canopen.Network()
        self.network.listeners.append(self._hear)
        self._news = threading.Condition()

    def _hear(self, message: can.Message) -> None:
        with self._news:
            self.heard.append(message)
            self._news.notify_all()

    def send(self, can_id: int, data: bytes = b"", remote: bool = False, extended: bool = False) -> None:
        """A raw frame. Skips the test where the link carries no remote frames."""
        if remote and not self.carries_remote_frames:
            pytest.skip("the socketcand protocol has no remote frames")
        self.network.bus.send(
            can.Message(arbitration_id=can_id, data=data, is_remote_frame=remote, is_extended_id=extended)
        )

    def sync(self, counter: int | None = None) -> None:
        """A SYNC, with a counter only if one is given (0x1019 is 0); in lockstep it has acted on return."""
        times = len(self.data(TIME))
        self.send(SYNC, b"" if counter is None else bytes((counter,)))
        if self.clock is Clock.SYNC:
            self._wait(lambda: len(self.data(TIME)) > times, "TIME after SYNC")

    def cycle(self, answer: int, counter: int | None = None) -> bytes:
        """A SYNC and the data of the next frame `answer`."""
        count = len(self.data(answer))
        self.sync(counter)
        self._wait(lambda: len(self.data(answer)) > count, f"0x{answer:03X} after SYNC")
        return self.data(answer)[-1]

    def data(self, can_id: int) -> list[bytes]:
        """Data of all frames of that CAN-ID."""
        return [bytes(m.data) for m in list(self.heard) if m.arbitration_id == can_id and not m.is_remote_frame]

    def await_frames(self, can_id: int, count: int = 1) -> list[bytes]:
        """The frames of that CAN-ID once there are `count`; time passes meanwhile."""
        self.until(lambda: len(self.data(can_id)) >= count, f"{count} frames 0x{can_id:03X}")
        return self.data(can_id)

    def await_answer(self, can_id: int) -> bytes:
        """The first frame of that CAN-ID, for which no time has to pass."""
        self._wait(lambda: self.data(can_id), f"0x{can_id:03X}")
        return self.data(can_id)[0]

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Time passes until the condition holds."""
        if self.clock is Clock.WALL:
            self._wait(condition, what)
            return
        for _ in range(LONGEST_MS):
            if condition():
                return
            self.let_pass()
        raise AssertionError(f"{what}: not within {LONGEST_MS} cycles of virtual time")

    def let_pass(self) -> None:
        """Lockstep: a little time passes."""
        self.sync()

    def _wait(self, condition: Callable[[], Any], what: str) -> None:
        limit = time.monotonic() + DEADLINE_S
        with self._news:
            while not condition():
                assert self._news.wait(limit - time.monotonic()), f"{what}: not within {DEADLINE_S:g} s"

    def nmt(self, command: int, node_id: int = 0) -> None:
        """An NMT command, to all nodes with 0. After a reset they have booted on return."""
        is_reset = command in (RESET_NODE, RESET_COMMUNICATION)
        targets = [each for each in NODE_IDS if node_id in (0, each) and is_reset]
        before = {each: self._boot_ups(each) for each in targets}
        self.send(0x000, bytes((command, node_id)))
        self._wait(lambda: all(self._boot_ups(each) > count for each, count in before.items()), "boot-up")

    def _boot_ups(self, node_id: int) -> int:
        return self.data(0x700 + node_id).count(b"\0")

    def card(self, node_id: int) -> canopen.RemoteNode:
        """The library's view of a card, from its EDS."""
        model = next(card.model for card in CELL.card if card.node_id == node_id)
        eds = io.StringIO(eds_text(model))
        eds.name = f"{model}.eds"
        node = self.network.add_node(node_id, eds)
        node.sdo.RESPONSE_TIMEOUT = DEADLINE_S
        return node

    def exchange(self, node_id: int, request: str) -> str:
        """One raw SDO request and its answer, in hex."""
        count = len(self.data(0x580 + node_id))
        self.send(0x600 + node_id, bytes.fromhex(request))
        self._wait(lambda: len(self.data(0x580 + node_id)) > count, f"answer of 0x{node_id:02X} to {request}")
        return self.data(0x580 + node_id)[-1].hex()

    def reset(self) -> None:
        """Every card as after power-on."""
        self.heard.clear()
        self.send(0x000, bytes((RESET_NODE, 0)))
        boot_ups = [0x700 + node_id for node_id in NODE_IDS]
        self._wait(lambda: all(b"\0" in self.data(can_id) for can_id in boot_ups), "boot-up of every card")
        for node_id in NODE_IDS:  # a round trip each: what was still under way has come
            self.exchange(node_id, "4000100000000000")
        self.heard.clear()
        self.network.nodes.clear()
        self.network.subscribers.clear()

    def close(self) -> None:
        self.network.disconnect()


class ExactLink(Link):
    """Bench and master in this process: virtual time, to the nanosecond."""

    def __init__(self) -> None:
        super().__init__(Clock.SYNC)
        self.bench = FaultBench(CELL, Truth.from_settings(CELL, SILENT), Clock.SYNC, seed=0)
        self.bench.start()
        self.bus = InProcessBus(self.bench, self._deliver)
        self.network.bus = self.bus

    def _deliver(self, message: can.Message) -> None:
        for listener in self.network.listeners:
            listener(message)

    def let_pass(self, time_ns: int = MILLISECOND) -> None:
        """Virtual time passes without SYNC."""
        self.bench.advance(self.bench.time_ns + time_ns)
        self.bus.hand_over()

    def stamps(self, can_id: int) -> list[int]:
        """When the frames of that CAN-ID were on the bus, ns."""
        return [round(message.timestamp * 1e9) for message in self.heard if message.arbitration_id == can_id]

    def close(self) -> None:
        self.bus.shutdown()


class Emulator:
    """`canarm emulator` in a process of its own."""

    def __init__(self, *arguments: str) -> None:
        inherited = {name: value for name, value in os.environ.items() if not name.startswith("CANARM_")}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "canarm", "emulator", "--serve", "127.0.0.1:0", "--sync-timeout", "600", *arguments],
            env={**inherited, "PYTHONUNBUFFERED": "1", "COLUMNS": "100"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._guard = threading.Timer(DEADLINE_S, self._process.kill)
        self._guard.start()
        self._lines: list[str] = []
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.append(line)
            if "bench" in line and "port=" in line:
                break
        self._guard.cancel()
        self._reader = threading.Thread(target=self._lines.extend, args=(self._process.stdout,), daemon=True)
        self._reader.start()
        self.port = int(self._found(r"^bench .*port=(\d+)"))

    def _found(self, pattern: str) -> str:
        for line in self._lines:
            if found := re.search(pattern, line):
                return found[1]
        raise AssertionError(f"{pattern!r} not in what the emulator said:\n{''.join(self._lines)}")

    @property
    def serial_channel(self) -> str:
        return self._found(r"^can0 +-i slcan -c (\S+)$")

    def close(self) -> None:
        """End it. It must still be there."""
        if self._process.poll() is not None:
            self._reader.join(DEADLINE_S)
            raise AssertionError("the emulator had ended by itself:\n" + "".join(self._lines))
        self._process.terminate()
        try:
            self._process.wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _bus_link(clock: Clock, interface: str, **bus: Any) -> Link:
    link = Link(clock, carries_remote_frames=interface not in ("canarm", "socketcand"))
    link.network.connect(interface=interface, **bus)
    return link


@pytest.fixture(scope="session")
def lockstep_emulator(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulator]:
    place: Path = tmp_path_factory.mktemp("adapter") / "can0"
    emulator = Emulator("--clock", "sync", *(["--slcan", str(place)] if os.name == "posix" else []))
    yield emulator
    emulator.close()


@pytest.fixture(scope="session")
def wall_clock_emulator() -> Iterator[Emulator]:
    emulator = Emulator("--clock", "wall")
    yield emulator
    emulator.close()


def _slow_to_boot(folder: Path) -> Path:
    """A file of the same cell whose cards take `BOOT_MS` to boot."""
    text = shipped_cells()["konkuk1"]
    assert "[bus]\n" in text
    assert "boot_ms" not in text
    file = folder / "konkuk1.toml"
    file.write_text(text.replace("[bus]\n", f"[bus]\nboot_ms = {BOOT_MS}\n"), encoding="utf-8")
    return file


def _on_socketcan(clock: Clock, folder: Path) -> Iterator[str]:
    """The interface of an emulator with that clock: the first that CANARM_SOCKETCAN names, or the second."""
    names = os.environ.get("CANARM_SOCKETCAN", "").replace(",", " ").split()
    if len(names) != 2:
        pytest.skip("CANARM_SOCKETCAN does not name two SocketCAN interfaces (such as vcan0,vcan1)")
    name = names[clock is Clock.SYNC]
    cell = _slow_to_boot(folder)
    emulator = Emulator("--cell", str(cell), "--clock", clock.name.lower(), "-i", "socketcan", "-c", name)
    yield name
    emulator.close()


@pytest.fixture(scope="session")
def lockstep_interface(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    yield from _on_socketcan(Clock.SYNC, tmp_path_factory.mktemp("cell"))


@pytest.fixture(scope="session")
def wall_clock_interface(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    yield from _on_socketcan(Clock.WALL, tmp_path_factory.mktemp("cell"))


@pytest.fixture(scope="session", params=LINKS)
def session_link(request: pytest.FixtureRequest) -> Iterator[Link]:
    kind, value = request.param, request.getfixturevalue
    if kind == "in-process":
        link: Link = ExactLink()
    elif kind == "canarm-sync":
        port = value("lockstep_emulator").port
        link = _bus_link(Clock.SYNC, interface="canarm", channel="can0", host="127.0.0.1", port=port)
    elif kind == "canarm-wall":
        port = value("wall_clock_emulator").port
        link = _bus_link(Clock.WALL, interface="canarm", channel="can0", host="127.0.0.1", port=port)
    elif kind == "socketcand-sync":
        port = value("lockstep_emulator").port
        link = _bus_link(Clock.SYNC, interface="socketcand", channel="can0", host="127.0.0.1", port=port)
    elif kind == "slcan-sync":
        if os.name != "posix":
            pytest.skip("this system has no pseudo-terminals")
        channel = value("lockstep_emulator").serial_channel
        link = _bus_link(Clock.SYNC, interface="slcan", channel=channel, bitrate=1_000_000, sleep_after_open=0.1)
    elif kind == "socketcan-sync":
        link = _bus_link(Clock.SYNC, interface="socketcan", channel=value("lockstep_interface"))
    else:
        link = _bus_link(Clock.WALL, interface="socketcan", channel=value("wall_clock_interface"))
    yield link
    link.close()


@pytest.fixture
def link(session_link: Link) -> Link:
    """Every link in turn, all cards in PRE-OPERATIONAL with their defaults."""
    session_link.reset()
    return session_link


@pytest.fixture
def exact() -> Iterator[ExactLink]:
    """The link in this process alone, for what needs exact virtual time."""
    link = ExactLink()
    link.reset()
    yield link
    link.close()
