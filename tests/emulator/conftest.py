"""Faults as the catalogue makes them, begun outside any bench; and a bench with a scripted master."""

import json
from collections.abc import Callable
from random import Random

import pytest

from canarm_emulator.bench.bench import Record
from canarm_emulator.bench.fault_hooks import FaultHooks
from canarm_emulator.faults.catalogue import make_fault
from canarm_emulator.faults.declaration import Context, JointFault, SignalFault
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.faults.taps import taps_of
from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import JointState
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.canopen.sdo import download
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock
from canarm_protocol.faults.script import FaultSpec, parse_faults
from tests.emulator.bench_sdo import Client
from tests.emulator.lone_node import Node


@pytest.fixture
def begin() -> Callable[..., SignalFault | JointFault]:
    """`begin(tap, fault, now_ns=0, seed=0, **parameters)` gives a fault of konkuk1 that has just begun."""
    taps = taps_of(load_cell("konkuk1"))

    def of(tap: str, name: str, now_ns: int = 0, seed: int = 0, **parameters: float) -> SignalFault | JointFault:
        fault = make_fault(taps, FaultSpec(tap, name, parameters))
        fault.begin(Context(taps[tap], now_ns, 2_500_000, Random(seed)))
        assert isinstance(fault, SignalFault | JointFault)
        return fault

    return of


@pytest.fixture
def bench() -> FaultBench:
    """A bench of konkuk1 that has just started, in lockstep."""
    cell = load_cell("konkuk1")
    bench = FaultBench(cell, Truth.from_settings(cell, {}), Clock.SYNC, seed=0)
    bench.start()
    return bench


@pytest.fixture
def client(bench: FaultBench) -> Client:
    """A client of it on the first SDO channel."""
    return Client(bench, 0, "client")


class Driven:
    """A bench of konkuk1 with a scripted master: heartbeats, outputs and SYNCs as a controller's, no law behind them.

    `log` gathers every record; `joints` the true joints at every SYNC.
    """

    MASTER = "master"

    def __init__(self, text: str, clock: Clock, with_wire: bool, seed: int, is_started: bool) -> None:
        cell = load_cell("konkuk1")
        self.bench = FaultBench(cell, Truth.from_settings(cell), clock, seed, with_wire)
        self.log: list[Record] = []
        self.joints: list[tuple[JointState, ...]] = []
        self.sent = 0
        self.bench.start()
        if text:
            self.inject(text)
        if is_started:
            self.start()

    def start(self) -> None:
        """Heartbeats and watches of all cards as a controller configures them; NMT start."""
        for node_id in (0x12, 0x13, 0x14):
            self.write(node_id, 0x1017, 0, (20).to_bytes(2, "little"))
            self.write(node_id, 0x1016, 1, (1 << 16 | 100).to_bytes(4, "little"))
        self.send(nmt_frame(NmtCommand.START))

    def write(self, node_id: int, index: int, subindex: int, data: bytes) -> None:
        self.send(Frame(0x600 + node_id, next(download(index, subindex, data))))
        if self.bench.clock is Clock.WALL:
            self.bench.advance(self.bench.time_ns + 500_000)  # both frames are over, also on the wire

    def inject(self, text: str) -> None:
        self.bench.inject(parse_faults(text))

    def send(self, *frames: Frame) -> list[Record]:
        for frame in frames:
            self.bench.receive(frame, self.MASTER)
        return self.taken()

    def taken(self) -> list[Record]:
        records, self.bench.records = self.bench.records, []
        self.log += records
        return records

    def cycles(self, count: int, is_heard: bool = True) -> list[Record]:
        """So many cycles of 0.1 A or 0.2 A by turns at joint 2; the records of all of them."""
        found = []
        for _ in range(count):
            frames = [Frame(0x312, (17 * (1 + self.sent % 2) << 7).to_bytes(2, "little") + bytes(6))]
            frames.append(Frame(0x213, b"\x02"))
            if is_heard and self.sent % 8 == 0:  # 20 ms
                frames.append(Frame(0x701, b"\x05"))
            if self.bench.clock is Clock.WALL:
                self.bench.advance(self.bench.time_ns + 1_900_000)
                found += self.send(*frames)
                self.bench.advance(self.bench.time_ns + 600_000)
                frames = []
            found += self.send(*frames, sync_frame(None))
            self.sent += 1
            self.joints.append(tuple(self.bench.world.state()))
        return found

    @property
    def is_sound(self) -> bool:
        """Whether no fault has left anything behind."""
        return self.bench.hooks == FaultHooks() and not self.bench.trouble.off and not self.bench.faults.active

    @property
    def stamps_never_go_back(self) -> bool:
        times = [record.time_ns for record in self.log]
        return times == sorted(times)


@pytest.fixture
def drive() -> Callable[..., Driven]:
    """`drive(text="", clock=Clock.SYNC, with_wire=False, seed=0, is_started=True)`."""

    def make(
        text: str = "", clock: Clock = Clock.SYNC, with_wire: bool = False, seed: int = 0, is_started: bool = True
    ) -> Driven:
        return Driven(text, clock, with_wire, seed, is_started)

    return make


@pytest.fixture
def fault_text() -> Callable[..., str]:
    """`fault_text(tap, fault, at=0.1, duration=0.05, **parameters)`: a set with one fault."""

    def make(
        tap: str, fault: str, at: float | None = 0.1, duration: float | None = 0.05, **parameters: float | str
    ) -> str:
        timing = {"at": at, "duration": duration}
        lines = [f"{key} = {value}" for key, value in timing.items() if value is not None]
        values = [f"{key} = {json.dumps(value)}" for key, value in parameters.items()]
        return "\n".join(["[[set]]", *lines, "[[set.fault]]", f'tap = "{tap}"', f'fault = "{fault}"', *values, ""])

    return make


@pytest.fixture
def node() -> Node:
    """The DAC card's node, alone."""
    return Node()


@pytest.fixture
def adc() -> Node:
    """The ADC card's node, alone."""
    return Node("adc0809")
