"""The desk against a real bench in this process: what the bench does, what it is asked, and how seldom."""

import pytest

from canarm_protocol.cell import bench_objects as objects
from canarm_tui import fault_desk
from canarm_tui.fault_desk import FaultDesk, Refusal
from canarm_tui.faults import FaultSignal
from canarm_tui.feed import Feed
from canarm_tui.link import Link

S = 1_000_000_000


class Dashboard:
    """What the application does at every drain."""

    def __init__(self, cell, loop, in_background=lambda job: job()):
        self.loop, self.feed, self.now_ns = loop, Feed(cell), 0
        self.link = Link(lambda: loop, "bench", in_background=lambda job: job())
        self.desk = FaultDesk(cell, self.link, in_background)
        self.answers = []

    def drain(self, seconds=0.05, times=1, has_telemetry=True):
        for _ in range(times):
            self.now_ns += round(seconds * S)
            if has_telemetry:
                self.loop.telemetry()
            self.feed.receive(self.link.poll(self.now_ns), self.now_ns)
            self.desk.poll(self.feed.faults, self.now_ns)

    def tap(self, name):
        found = []
        self.desk.load_catalogue(found.append)
        self.drain(times=2)
        return next(tap for tap in found[0] if tap.name == name)

    def inject(self, name, fault, typed, **schedule):
        tap = self.tap(name)
        kind = next(each for each in tap.faults if each.name == fault)
        self.desk.inject(tap.name, kind, typed, schedule, self.answers.append)
        self.drain(times=3)
        return self.answers[-1]


@pytest.fixture
def dashboard(cell, loop):
    return Dashboard(cell, loop)


def test_a_fault_that_is_injected_acts_and_is_known(dashboard, loop):
    assert dashboard.inject("joint2.tachometer", "stuck", {"value": "2.5"}) == "accepted 'joint2.tachometer stuck'"
    assert loop.bench.device.faults.active == 1
    dashboard.drain(seconds=0.5, times=3)
    (acting,) = dashboard.desk.faults.acting
    assert (acting.tap, acting.fault, acting.began.cycle) == ("joint2.tachometer", "stuck", -1)
    assert dashboard.feed.faults == FaultSignal(1, False, 1)


def test_the_emergency_stop_does_not_wait_for_a_conversation_that_is_on(cell, loop):
    """As while the catalogue is read, which takes a second, and more on a busy machine."""
    dashboard = Dashboard(cell, loop)
    dashboard.drain(times=2)
    waiting = []
    desk = FaultDesk(cell, dashboard.link, waiting.append)
    desk.load_catalogue(lambda answer: None)
    desk.poll(None, dashboard.now_ns)
    assert len(waiting) == 1, "it is on"
    desk.stop(True, lambda answer: None)
    assert loop.bench.device.is_stopped


def test_the_bench_says_what_is_wrong_and_nothing_is_injected(dashboard, loop):
    answer = dashboard.inject("joint2.tachometer", "stuck", {"value": "99"})
    assert isinstance(answer, Refusal)
    assert "value = 99: must be a number from 0 to 5 V" in answer.reason
    assert loop.bench.device.faults.active == 0


def test_a_second_fault_of_the_same_name_gets_a_number(dashboard):
    dashboard.inject("joint2.tachometer", "stuck", {"value": ""})
    assert dashboard.inject("joint2.tachometer", "stuck", {"value": ""}) == "accepted 'joint2.tachometer stuck #2'"


def test_one_set_is_cleared_or_all(dashboard, loop):
    for tap in ("joint2.tachometer", "joint3.tachometer", "joint2.potentiometer"):
        dashboard.inject(tap, "stuck", {"value": "1"})
    dashboard.desk.clear("joint2.tachometer stuck", dashboard.answers.append)
    dashboard.drain(times=3)
    assert loop.bench.device.faults.active == 2
    dashboard.desk.clear(None, dashboard.answers.append)
    dashboard.drain(times=3)
    assert loop.bench.device.faults.active == 0
    dashboard.desk.clear("nobody", dashboard.answers.append)
    dashboard.drain(times=3)
    assert "nobody" in dashboard.answers[-1].reason


def test_the_emergency_stop_goes_on_and_off(dashboard, loop):
    dashboard.drain()
    for is_on in (True, False):
        dashboard.desk.stop(is_on, dashboard.answers.append)
        dashboard.drain(times=3)
        assert loop.bench.device.is_stopped is is_on
        assert dashboard.feed.faults.is_stopped is is_on
    assert dashboard.answers[0].endswith("is open")
    assert dashboard.answers[1].endswith("is closed again")


def test_nothing_is_asked_before_the_bench_sends_telemetry(dashboard, loop):
    dashboard.drain(times=100, has_telemetry=False)
    assert loop.requests == []


def test_without_a_change_the_status_is_asked_every_two_seconds_and_events_never(dashboard, loop):
    dashboard.drain(times=200)  # 10 s
    assert loop.requests.count(objects.FAULT_STATUS) == 5
    assert objects.PACKED_EVENTS not in loop.requests


def test_changes_are_asked_for_at_most_twice_a_second(dashboard, loop):
    dashboard.inject("joint2.tachometer", "stuck", {"value": ""})
    del loop.requests[:]
    engine_events = loop.bench.device.faults
    for _ in range(100):  # 5 s
        engine_events.begun += 1
        dashboard.drain()
    assert 8 <= loop.requests.count(objects.FAULT_STATUS) <= 11


def test_a_set_that_waits_is_known_within_two_seconds_though_no_telemetry_tells(dashboard, loop):
    dashboard.drain(times=10)
    loop.bench.device.faults.write(
        b'[[set]]\nname = "later"\nmanual = true\n[[set.fault]]\ntap = "joint2.latch"\nfault = "stuck"\n', 2
    )
    dashboard.drain(times=41)
    assert dashboard.desk.faults.waiting == ("later",)


def test_a_fault_that_comes_and_goes_between_two_looks_is_in_the_events(dashboard, loop):
    dashboard.drain(times=10)
    loop.bench.device.faults.write(b'[[set]]\n[[set.fault]]\ntap = "joint2.latch"\nfault = "stuck"\n', 2)
    loop.bench.device.faults.write(b'clear = ""', 2)
    dashboard.drain(times=12)
    assert [event.is_begin for event in dashboard.desk.faults.events] == [False, True]


def test_after_the_users_own_doing_the_status_is_asked_at_once(dashboard, loop):
    loop.bench.device.faults.write(
        b'[[set]]\nname = "later"\nmanual = true\n[[set.fault]]\ntap = "joint2.latch"\nfault = "stuck"\n', 2
    )
    dashboard.drain(times=3)
    assert dashboard.desk.faults.waiting == ("later",)
    dashboard.desk.clear("later", dashboard.answers.append)
    dashboard.drain(times=4)
    assert dashboard.desk.faults.waiting == ()


def test_the_catalogue_is_asked_for_once_in_a_connection(dashboard, loop):
    dashboard.tap("joint2.tachometer")
    dashboard.tap("joint2.tachometer")
    assert loop.requests.count(objects.PACKED_CATALOGUE) == 1
    dashboard.desk.reconnected()
    dashboard.tap("joint2.tachometer")
    assert loop.requests.count(objects.PACKED_CATALOGUE) == 2


def test_a_bench_that_does_not_answer_is_a_reason_and_asked_again_later(dashboard, loop, monkeypatch):
    monkeypatch.setattr(fault_desk, "LIMIT_S", 0.01)
    loop.is_silent = True
    dashboard.drain(times=20)
    assert "has not answered within 0.01 s" in dashboard.desk.refusal.reason
    asked = loop.requests.count(objects.CHANNEL_OWNER)
    assert asked == 1
    loop.is_silent = False
    dashboard.drain(times=110)
    assert dashboard.desk.refusal is None
    assert dashboard.desk.faults is not None


def test_a_lost_bus_is_a_reason(dashboard, loop):
    dashboard.drain(times=2)
    loop.is_broken = True
    dashboard.drain(times=1)
    dashboard.desk.clear(None, dashboard.answers.append)
    dashboard.drain(times=2)
    assert dashboard.answers[-1].reason == "not connected: -i loop -c bench: the server closed the connection"


def test_a_stop_that_a_broken_bus_does_not_take_is_not_called_sent(dashboard, loop):
    dashboard.drain(times=2)
    loop.is_broken = True
    dashboard.desk.stop(True, dashboard.answers.append)
    why = "-i loop -c bench: the server closed the connection"
    assert dashboard.answers == [Refusal(f"emergency stop NOT sent: {why}")], "at once"


def test_what_no_one_foresaw_is_a_reason_too(dashboard, loop, monkeypatch):
    monkeypatch.setattr(fault_desk, "catalogue_of", lambda plain: {}["taps"])
    dashboard.desk.load_catalogue(dashboard.answers.append)
    dashboard.drain(times=3)
    assert dashboard.answers == [Refusal("-i loop -c bench: KeyError: 'taps'")]


def test_one_question_at_a_time_and_the_users_come_first(cell, loop):
    jobs = []
    dashboard = Dashboard(cell, loop, in_background=jobs.append)
    dashboard.drain()
    dashboard.desk.load_catalogue(lambda answer: dashboard.answers.append("catalogue"))
    dashboard.desk.stop(True, lambda answer: dashboard.answers.append("stop"))
    dashboard.drain(times=5)
    assert len(jobs) == 1, "a second conversation began while one was on"
    while jobs:
        jobs.pop()()
        dashboard.drain()
        if dashboard.answers == ["stop", "catalogue"]:
            break
    assert dashboard.answers == ["stop", "catalogue"]
