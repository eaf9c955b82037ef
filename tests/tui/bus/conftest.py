"""A bus that is watched, filled by hand; its clock is the frozen one of the dashboard's tests."""

import pytest

from canarm_protocol.decoding import Book, robot_book
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
