"""The view of events: choose, filter, jump; and what the bench says of the law, by a real bench in this process."""

import contextlib

import pytest

from canarm_controller.bus.assessment import name_law
from canarm_protocol.canopen.frames import Emergency, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.cell.bench_objects import CONTROLLER_CHANNEL, sdo_channel
from canarm_protocol.decoding import robot_book
from canarm_protocol.faults.fault_events import FaultEvent
from canarm_protocol.transport.sdo_session import SdoSession
from canarm_tui import DashboardApp
from canarm_tui.bus.watch import BusWatch
from canarm_tui.events import Happening
from canarm_tui.events_view import EventsPane
from canarm_tui.joints_view import JointsPane
from canarm_tui.views import Scene
from tests.tui.screens import screen_lines

FAULTS = """
[[set]]
name = "{name}"
[[set.fault]]
tap = "joint2.{tap}"
fault = "stuck"
"""


@contextlib.asynccontextmanager
async def running(cell, loop, clock, size=(120, 30)):
    app = DashboardApp(cell, lambda: loop, clock_ns=clock, in_background=lambda job: job())
    async with app.run_test(size=size) as pilot:

        async def press(*keys):
            await pilot.press(*keys)
            for _ in range(4):
                clock.advance(0.5)
                loop.telemetry()
                app.drain()
            app.redraw()
            await pilot.pause()

        await press()
        yield app, press


def inject(loop, name, tap):
    loop.bench.device.faults.write(FAULTS.format(name=name, tap=tap).encode(), 2)


def list_of(app):
    return [" ".join(word.text for word in line) for line in app.query_one(EventsPane).lines]


async def test_events_are_listed_newest_first_and_the_chosen_one_stays_chosen(cell, loop, clock):
    async with running(cell, loop, clock) as (app, press):
        await press("2")
        assert list_of(app)[0].startswith("nothing has happened yet")
        inject(loop, "first", "tachometer")
        inject(loop, "second", "potentiometer")
        await press()
        assert ["second" in list_of(app)[0], "first" in list_of(app)[1]] == [True, True]
        await press("down")
        inject(loop, "third", "current_sense")
        await press()
        events = app.query_one("#events")
        assert "first" in list_of(app)[events.highlighted]
        assert any("fault begins: joint2.current_sense stuck (third)" in line for line in screen_lines(app))


async def test_a_selection_that_was_never_moved_stays_on_the_newest(cell, loop, clock):
    async with running(cell, loop, clock) as (app, press):
        await press("2")
        for name, tap in (("first", "tachometer"), ("second", "potentiometer"), ("third", "current_sense")):
            inject(loop, name, tap)
            await press()
            assert name in list_of(app)[app.query_one("#events").highlighted]
        await press("down", "up")
        inject(loop, "fourth", "dac.code")
        await press()
        assert "fourth" in list_of(app)[app.query_one("#events").highlighted], "back on the newest"


async def test_words_filter_the_list_and_escape_shows_all(cell, loop, clock):
    inject(loop, "first", "tachometer")
    inject(loop, "second", "potentiometer")
    async with running(cell, loop, clock) as (app, press):
        await press("2", "slash", *"TACHO begins")
        assert len(list_of(app)) == 1
        assert "first" in list_of(app)[0]
        await press("x")
        assert list_of(app)[0].startswith("none of the events has all of these words")
        await press("enter", "enter")
        assert app.view.name == "events", "there is nothing to jump to"
        await press("escape")
        assert len(list_of(app)) == 2


@pytest.mark.parametrize(("cycle", "is_kept"), [(400, True), (100_000, False)])
async def test_enter_shows_the_traces_at_the_moment_of_the_event(cell, port, clock, wire, cycle, is_kept):
    app = DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job())
    async with app.run_test(size=(120, 30)) as pilot:
        for each in range(0, 4000, 4):
            port.arriving += wire.reference(each) + wire.telemetry(each)
        app.drain()
        app.redraw()
        await pilot.press("2")
        pane = app.query_one(EventsPane)
        pane.show(
            Scene(app.feed.snapshot(clock()), (Happening(FaultEvent(1, cycle, True, "s", "joint2.dac", "stuck")),))
        )
        await pilot.press("enter")
        await pilot.pause()
        assert app.view.name == "joints"
        assert app.query_one(JointsPane).timeline.cursor == min(cycle, 3996)
        app.redraw()
        await pilot.pause()
        is_said = any(f"cycle {cycle} is not among those that are kept" in line for line in screen_lines(app))
        assert is_said is not is_kept


async def test_what_the_controller_and_the_nodes_tell_is_among_the_events(cell, port, clock, wire):
    """Its states and late cycles from the bench bus, EMCY, NMT and states of nodes from the robot's."""
    robot_bus = type(port)()
    watch = BusWatch(robot_book(cell), lambda: robot_bus, "-i fake -c can0", in_background=lambda job: job())
    app = DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job(), bus=watch)
    async with app.run_test(size=(120, 30)) as pilot:
        watch.listen()

        async def press(*keys):
            await pilot.press(*keys)
            for _ in range(3):
                app.drain()
                clock.advance(0.5)
            app.redraw()
            await pilot.pause()

        await press("2")
        robot_bus.arriving = [(0, nmt_frame(NmtCommand.START)), (0, sync_frame(1)), (0, sync_frame(2))]
        robot_bus.arriving += [(0, Emergency(0x8130, 0x11).frame(0x14))]
        port.arriving = wire.telemetry(4) + wire.report(0, 0, 6) + wire.report(2, 0, 2) + wire.report(16, 3, 3)
        await press()
        assert list_of(app) == [
            "0.040 s (cycle 16) ▸ controller stopping",
            "0.040 s (cycle 16) × 3 cycles missed or begun late",
            "0.005 s (cycle 2) ▸ controller running",
            "0.003 s (cycle 1) ! EMCY of adc: 0x8130 life guard or heartbeat error, error register 0x11 (generic, "
            "communication)",
            "0.000 s (cycle 0) ▸ controller homing",
            "before cycle 0 » NMT: start to all nodes",
        ]
        await press("slash", *"emcy adc")
        assert len(list_of(app)) == 1
        await press("enter", "enter")
        assert app.view.name == "joints"
        assert robot_bus.sent == []


async def test_the_law_and_its_values_are_called_what_the_controller_has_told_the_bench(cell, loop, clock, wire):
    session = SdoSession(loop, *sdo_channel(cell.bus.bench_node_id, CONTROLLER_CHANNEL))
    name_law(session, "mras", ["alpha", "beta"])
    async with running(cell, loop, clock) as (app, press):
        app.feed.receive(wire.report(8, 0, 2), clock())
        await press()
        await press()
        lines = screen_lines(app)
        assert "konkuk1 │ mras" in lines[0]
        assert any("alpha" in line for line in lines)
        await press("a")
        assert any("beta" in line for line in screen_lines(app))


async def test_the_law_of_the_next_controller_is_asked_for_after_one_was_lost(cell, loop, clock, wire):
    session = SdoSession(loop, *sdo_channel(cell.bus.bench_node_id, CONTROLLER_CHANNEL))
    name_law(session, "mras", ["alpha", "beta"])
    async with running(cell, loop, clock) as (app, press):
        app.feed.receive(wire.report(800, 0, 2), clock())
        await press()
        assert "✖ controller lost" in screen_lines(app)[0], "two seconds without a report"
        name_law(session, "pd", ["gamma"])
        app.feed.receive(wire.report(1600, 0, 2), clock())
        await press()
        assert "konkuk1 │ pd" in screen_lines(app)[0]
