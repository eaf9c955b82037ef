"""One bus for the dashboard and a conversation: both get every frame, and neither keeps the other from leaving."""

import threading

import pytest

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.errors import BusError
from canarm_tui.link import Link
from canarm_tui.shared_port import LONGEST_WAIT_S, SharedPort

FIRST, SECOND = (1, Frame(0x100)), (2, Frame(0x101))


class Patient:
    """A port that notes how long it was to wait."""

    def __init__(self, port):
        self.waits_s = []
        port.receive = self.receive
        self.arriving = []

    def receive(self, timeout_s):
        self.waits_s.append(timeout_s)
        arrived, self.arriving = self.arriving, []
        return arrived


def test_what_a_conversation_reads_the_dashboard_gets_too_in_order(port):
    patient, shared = Patient(port), SharedPort(port)
    with shared.lend() as lent:
        patient.arriving = [FIRST]
        assert lent.receive(1.0) == [FIRST]
        patient.arriving = [SECOND]
        assert shared.receive() == [FIRST]
        assert patient.arriving == [SECOND], "the dashboard took from under the conversation what it waits for"
        assert lent.receive(1.0) == [SECOND]
    assert shared.receive() == [SECOND]
    assert shared.receive() == []


def test_a_conversation_never_waits_long_without_a_look_whether_it_is_still_wanted(port):
    patient, shared = Patient(port), SharedPort(port)
    with shared.lend() as lent:
        lent.receive(5.0)
        lent.receive(0.0)
    assert patient.waits_s == [LONGEST_WAIT_S, 0.0]


def test_a_bus_that_is_given_back_ends_the_conversation_and_is_closed_then(port):
    Patient(port)
    shared = SharedPort(port)
    with shared.lend() as lent:
        shared.close()
        assert not port.is_closed, "closed while another thread reads from it"
        with pytest.raises(BusError, match="was closed meanwhile"):
            lent.receive(1.0)
    assert port.is_closed


def test_closing_does_not_wait_for_a_conversation(port):
    Patient(port)
    shared = SharedPort(port)
    begun, end = threading.Event(), threading.Event()

    def converse():
        with shared.lend():
            begun.set()
            end.wait(60.0)

    thread = threading.Thread(target=converse)
    thread.start()
    assert begun.wait(60.0)
    shared.close()
    assert shared.receive() == []
    end.set()
    thread.join()
    assert port.is_closed


def test_without_a_bus_there_is_nothing_to_lend_and_the_reason_is_told():
    def refuse():
        raise BusError("nobody listens there")

    link = Link(refuse, "bench", in_background=lambda job: job())
    link.poll(0)
    with pytest.raises(BusError, match="not connected: nobody listens there"):
        link.lend()
