"""A bus that is watched before anybody looks: as long as that costs little."""

import pytest

from canarm_protocol.decoding import robot_book
from canarm_tui.bus.watch import MOST_UNSEEN, UNSEEN_NS, BusWatch
from tests.tui.bus.frames import at_once, frame


@pytest.fixture
def watch(cell, port):
    return BusWatch(robot_book(cell), lambda: port, "a bus", None, at_once)


def hear(watch, port, frames, now_ns):
    port.arriving = [(now_ns, frame("123#00"))] * frames
    watch.poll(now_ns)
    assert not port.arriving


def test_a_bus_is_not_opened_before_somebody_wants_it(watch, port):
    port.arriving = [(0, frame("123#00"))]
    watch.poll(0)
    assert (watch.link.connections, watch.now(0).received) == (0, 0)


def test_what_comes_before_anybody_looks_is_kept(watch, port):
    watch.listen()
    for second in range(3):
        hear(watch, port, MOST_UNSEEN, second * UNSEEN_NS)
    watch.wake()
    hear(watch, port, 1, 3 * UNSEEN_NS)
    assert watch.now(0).received == 3 * MOST_UNSEEN + 1


def test_a_bus_on_which_too_much_comes_is_given_back_until_somebody_looks(watch, port):
    watch.listen()
    port.arriving = [(0, frame("123#00"))] * (MOST_UNSEEN + 1)
    watch.poll(0)
    assert port.is_closed
    assert not watch.is_awake
    assert watch.now(0).received == 0
    watch.wake()
    for _ in range(2):
        hear(watch, port, MOST_UNSEEN + 1, 1)
    assert watch.now(0).received == 2 * MOST_UNSEEN + 2
