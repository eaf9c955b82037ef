"""A bus that is watched, filled by hand; its clock is the frozen one of the dashboard's tests."""

import pytest

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.clock import Clock
from canarm_protocol.decoding import Book, robot_book
from canarm_protocol.transport.port import BusPort, Discarded
from canarm_tui.bus.monitor import MonitorApp
from canarm_tui.bus.watch import BusWatch
from tests.tui.bus.frames import at_once


@pytest.fixture
def watch(cell, port):
    return BusWatch(robot_book(cell), lambda: port, "-i fake -c can0", cell.bus.bitrate, at_once)


@pytest.fixture
def unknown(port):
    """A bus of which nothing is known."""
    return BusWatch(Book(), lambda: port, "-i fake -c vcan0", None, at_once)


@pytest.fixture
def monitor(watch, clock):
    return MonitorApp(watch, clock_ns=clock)


class CardsOnABus(BusPort):
    """The robot's bus of a real bench, without a socket: what is sent is done at once, the answers are there to read.

    Time stands still (lockstep without SYNC). Who receives gets nothing of what he has sent himself.
    """

    def __init__(self, cell):
        self.description = "-i loop -c can0"
        self.discarded = Discarded()
        self.bench = FaultBench(cell, Truth.from_settings(cell, {}), Clock.SYNC, seed=0)
        self.bench.start()
        self.sent = []
        self.is_silent = self.is_closed = False

    def send(self, frames):
        self.sent += frames
        for each in frames:
            if not self.is_silent:
                self.bench.receive(each, "monitor")

    def receive(self, timeout_s):
        records, self.bench.records = self.bench.records, []
        return [(each.time_ns, each.frame) for each in records if each.origin != "monitor"]

    def fileno(self):
        return None

    def close(self):
        self.is_closed = True


@pytest.fixture
def cards(cell):
    return CardsOnABus(cell)
