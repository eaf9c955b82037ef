"""The link: announces a listener, loses the bus without an exception, comes back."""

import pytest

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.errors import BusError
from canarm_tui.link import Link, LinkState

MS = 1_000_000


class Opener:
    """Opens the given ports one after the other; an exception in the list is raised."""

    def __init__(self, *results):
        self.results = list(results)
        self.calls = 0

    def __call__(self):
        self.calls += 1
        result = self.results.pop(0)
        if isinstance(result, Exception):
            raise result
        return result


def at_once(job):
    job()


@pytest.fixture
def second_port(port):
    return type(port)()


def test_a_heartbeat_of_node_0x31_in_operational_goes_out_every_half_second(port):
    link = Link(Opener(port), "bench", in_background=at_once)
    for now_ns in range(0, 1100 * MS, 50 * MS):
        link.poll(now_ns)
    assert port.sent == [Frame(0x731, b"\x05")] * 3  # at 0, 0.5 and 1 s


def test_everything_that_has_arrived_is_taken(port):
    link = Link(Opener(port), "bench", in_background=at_once)
    port.arriving = [(1, Frame(0x100)), (2, Frame(0x101))]
    assert link.poll(0) == [(1, Frame(0x100)), (2, Frame(0x101))]
    assert link.state is LinkState.CONNECTED


def test_a_bus_that_never_falls_silent_does_not_hold_the_dashboard(port):
    port.receive = lambda timeout_s: [(0, Frame(0x100))]
    assert len(Link(Opener(port), "bench", in_background=at_once).poll(0)) == 16


def test_a_lost_bus_is_closed_and_opened_again_after_a_second(port, second_port):
    opener = Opener(port, second_port)
    link = Link(opener, "bench", in_background=at_once)
    link.poll(0)
    port.is_broken = True
    link.poll(100 * MS)
    assert (link.state, port.is_closed) == (LinkState.LOST, True)
    assert "the server closed the connection" in link.reason
    link.poll(1099 * MS)
    assert opener.calls == 1
    link.poll(1100 * MS)
    assert (link.state, link.connections) == (LinkState.CONNECTED, 2)
    assert second_port.sent == [Frame(0x731, b"\x05")]


@pytest.mark.parametrize("error", [BusError("-i canarm: nobody listens there"), ZeroDivisionError("in a driver")])
def test_whatever_goes_wrong_at_opening_is_a_reason_and_not_a_crash(port, error):
    link = Link(Opener(error, port), "-i canarm", in_background=at_once)
    link.poll(0)
    assert link.state is LinkState.LOST
    assert str(error) in link.reason
    link.poll(1000 * MS)
    assert link.state is LinkState.CONNECTED


def test_frames_read_before_the_loss_are_not_lost(port):
    answers = iter([[(1, Frame(0x100))]])

    def receive(timeout_s):
        try:
            return next(answers)
        except StopIteration:
            raise BusError("gone") from None

    port.receive = receive
    link = Link(Opener(port), "bench", in_background=at_once)
    assert link.poll(0) == [(1, Frame(0x100))]
    assert link.state is LinkState.LOST


def test_while_the_bus_is_being_opened_polling_goes_on_and_opens_no_second_one(port):
    jobs = []
    link = Link(Opener(port), "bench", in_background=jobs.append)
    for now_ns in (0, 500 * MS, 5000 * MS):
        assert link.poll(now_ns) == []
        assert link.state is LinkState.CONNECTING
    assert len(jobs) == 1
    jobs[0]()
    link.poll(5050 * MS)
    assert link.state is LinkState.CONNECTED


def test_a_port_that_opens_after_the_user_has_left_is_closed(port):
    jobs = []
    link = Link(Opener(port), "bench", in_background=jobs.append)
    link.poll(0)
    link.close()
    jobs[0]()
    assert port.is_closed


def test_what_ports_discard_is_summed_over_reconnections(port, second_port):
    link = Link(Opener(port, second_port), "bench", in_background=at_once)
    link.poll(0)
    port.discarded.error_frames, port.discarded.fd_frames = 3, 1
    port.is_broken = True
    link.poll(100 * MS)
    link.poll(1100 * MS)
    second_port.discarded.fd_frames = 2
    assert link.discarded == 6
