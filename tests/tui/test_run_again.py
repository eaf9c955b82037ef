"""Running again from the dashboard: asked when a run is over, refused while one goes on; each run has its bus."""

import contextlib

import pytest

from canarm_protocol.errors import BusError
from canarm_protocol.faults.detection_events import DetectionEvent
from canarm_tui import DashboardApp
from canarm_tui.events_view import EventsPane
from canarm_tui.faults import Faults
from canarm_tui.outcome import Outcome
from canarm_tui.run_again import AgainScreen, NextRun
from tests.tui.screens import screen_lines

LAST = NextRun("pd", "sine", "0", "1")


class Runs:
    """Runs that begin when asked to; `refusal` is why they do not."""

    def __init__(self):
        self.last, self.hints = LAST, NextRun("pd, mras", "sine", "a number", "or max")
        self.folder = "run"
        self.begun = []
        self.refusal = None
        self.ends_here = True

    @property
    def number(self):
        return 1 + len(self.begun)

    def start(self, wanted):
        if self.refusal is not None:
            raise BusError(self.refusal)
        self.begun.append(wanted)
        return f"running again: {wanted.law}"


@pytest.fixture
def runs():
    return Runs()


@contextlib.asynccontextmanager
async def over(cell, clock, runs, ports, size=(80, 24)):
    """A dashboard whose first run is over."""
    app = DashboardApp(
        cell,
        lambda: ports[len(runs.begun)],
        clock_ns=clock,
        in_background=lambda job: job(),
        outcome_of=lambda: None if runs.begun else Outcome("DONE: konkuk1", True, ["recorded in run"]),
        again=runs,
    )
    async with app.run_test(size=size) as pilot:

        async def press(*keys):
            await pilot.press(*keys)
            app.drain()
            await pilot.pause()
            app.redraw()
            await pilot.pause()

        await press()
        yield app, press


async def test_the_same_run_again_is_two_keys_and_is_shown_from_its_own_bus(cell, clock, runs, port, wire):
    ports = [port, type(port)()]
    async with over(cell, clock, runs, ports) as (app, press):
        assert any("✓ DONE: konkuk1 │ r runs again │ q leaves" in line for line in screen_lines(app))
        port.arriving = wire.telemetry(800)
        await press("r")
        assert isinstance(app.screen, AgainScreen)
        ports[1].arriving = wire.telemetry(4)
        await press("enter")
        assert runs.begun == [LAST]
        await press()
        assert app.outcome is None
        assert port.is_closed
        assert app.feed.snapshot(clock()).cycle == 4
        lines = screen_lines(app)
        assert not any("DONE" in line for line in lines)
        assert any("✓ running again: pd" in line for line in lines)


async def test_a_run_that_was_begun_elsewhere_is_shown_from_its_own_bus(cell, clock, runs, port, wire):
    """From another page of the same demo."""
    ports = [port, type(port)()]
    async with over(cell, clock, runs, ports) as (app, press):
        port.arriving = wire.telemetry(800)
        await press()
        ports[1].arriving = wire.telemetry(4)
        runs.start(LAST)
        await press()
        await press()
        assert app.outcome is None
        assert app.feed.snapshot(clock()).cycle == 4


async def test_while_another_run_is_being_started_nothing_is_lost(cell, clock, runs, port, wire):
    """The buses of the last one are closed for some seconds."""
    jobs = []
    async with over(cell, clock, runs, [port, type(port)()]) as (app, press):
        port.arriving = wire.telemetry(800)
        await press("r")
        app._in_background = jobs.append
        await press("enter")
        port.is_broken = True
        await press()
        assert any(line.startswith(" … starting a run") for line in screen_lines(app))
        assert any("another run is being started" in line for line in screen_lines(app))
        assert not any("✖ lost" in line or "the server closed" in line for line in screen_lines(app))
        jobs.pop()()
        await press()
        assert not app.is_starting


def seen(app):
    return [" ".join(word.text for word in line) for line in app.query_one(EventsPane).lines]


async def test_events_of_earlier_runs_stay_run_by_run_with_their_detections(cell, clock, runs, port, wire):
    """Cycles and bus times begin anew with each run: neither may decide which stands first."""
    ports = [port, type(port)(), type(port)()]
    async with over(cell, clock, runs, ports, (120, 30)) as (app, press):
        for number, cycle in ((1, 900), (2, 500)):
            ports[number - 1].arriving = wire.telemetry(cycle) + wire.report(cycle, 0, 2)
            await press("2")
            found = DetectionEvent(cycle + 2, "encoder-lost", "joint2", "no pulses", "substitute", 1_000_000_000)
            app.desk.faults = Faults(detections=(found,))
            clock.advance(1.0)
            await press()
            runs.start(LAST)
            await press()
            clock.advance(1.0)
            await press()
        ports[2].arriving = wire.telemetry(700) + wire.report(700, 0, 2)
        await press()
        clock.advance(1.0)
        await press()
        assert seen(app) == [
            "1.750 s (cycle 700) ▸ controller running",
            "run-2: 1.255 s (cycle 502) ◆ detected: encoder-lost at joint2 substitute no pulses",
            "run-2: 1.250 s (cycle 500) ▸ controller running",
            "run-1: 2.255 s (cycle 902) ◆ detected: encoder-lost at joint2 substitute no pulses",
            "run-1: 2.250 s (cycle 900) ▸ controller running",
        ]
        await press("down", "down", "enter")
        assert app.view.name == "events"
        assert any("run-2 is over, and its traces are not kept here" in line for line in screen_lines(app))


async def test_another_law_and_seed_are_typed_into_a_form(cell, clock, runs, port):
    async with over(cell, clock, runs, [port, port]) as (_, press):
        await press("r", "backspace", "backspace", *"mras", "down", "down", "backspace", *"7", "enter")
        assert runs.begun == [NextRun("mras", "sine", "7", "1")]


async def test_a_run_that_cannot_be_is_said_in_the_form_and_the_last_one_stays(cell, clock, runs, port):
    runs.refusal = "law 'pdx': no such law"
    async with over(cell, clock, runs, [port]) as (app, press):
        await press("r", "x", "enter")
        assert any("law 'pdx': no such law" in line for line in screen_lines(app))
        await press("escape")
        assert any("DONE: konkuk1" in line for line in screen_lines(app))
        assert len(app.screen_stack) == 1


async def test_while_a_run_goes_on_it_is_not_run_again(cell, clock, runs, port):
    app = DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job(), again=runs)
    async with app.run_test(size=(100, 30)) as pilot:
        port.arriving = []
        await pilot.press("r")
        assert len(app.screen_stack) == 1
        app.redraw()
        assert "Q ends it" in app.answer.text
