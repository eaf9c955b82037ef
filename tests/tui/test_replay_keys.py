"""Keys while a recorded run plays: what only a live run can do is said, and n reaches all that has happened."""

import asyncio
import contextlib
from dataclasses import replace

import pytest

from canarm_protocol.canopen.frames import NmtCommand, nmt_frame
from canarm_tui import DashboardApp
from canarm_tui.notices import Kind, Notice
from canarm_tui.player import NOBODY
from tests.tui.bus.frames import cycles
from tests.tui.screens import screen_lines
from tests.tui.test_player import CYCLES, END, record  # noqa: F401  # the record is a fixture

STOPPING = Notice(0, CYCLES + 1, Kind.CONTROLLER, "controller stopping")


@contextlib.asynccontextmanager
async def played(record, clock):  # noqa: F811
    app = DashboardApp(record.cell, lambda: pytest.fail("no bus"), clock_ns=clock, record=record)
    async with app.run_test(size=(120, 30)) as pilot:

        async def press(*keys):
            await pilot.press(*keys)
            app.drain()
            app.redraw()
            await pilot.pause()
            return "\n".join(screen_lines(app))

        await press("space")
        yield app, press


@pytest.mark.parametrize("key", ["f", "e", "x", "R", "w", "r"])
async def test_a_key_that_needs_a_bench_says_that_this_is_a_record(record, clock, key):  # noqa: F811
    async with played(record, clock) as (_, press):
        assert NOBODY not in await press()
        assert NOBODY in await press(key)


@pytest.mark.parametrize("key", ["q", "Q"])
async def test_a_record_is_left_by_either_key_for_nothing_runs(record, clock, key):  # noqa: F811
    async with played(record, clock) as (app, _):
        assert len(app.screen_stack) == 1
        app.simulate_key(key)
        while app.is_running:
            await asyncio.sleep(0)
    assert app.return_code == 0


async def test_the_cards_are_not_offered_by_hand_and_t_says_why(record, clock):  # noqa: F811
    async with played(record, clock) as (_, press):
        assert "By hand" not in await press("5")
        assert NOBODY in await press("t")


async def test_n_goes_to_the_end_of_the_run_and_then_says_that_there_is_no_more(record, clock):  # noqa: F811
    async with played(replace(record, noticed=(STOPPING,)), clock) as (app, press):
        app.player.seek(END)
        assert "no further event" not in await press("n")
        assert app.player.cycle == CYCLES - 1, "the last cycle that was recorded"
        assert "controller stopping" in await press("2")
        assert "no further event" in await press("n")
        app.player.seek(0)
        assert "no event before" in await press("N")


async def test_the_load_of_a_record_that_stands_is_that_of_where_it_stands(record, clock):  # noqa: F811
    frames = [(0, nmt_frame(NmtCommand.START)), *cycles(0, 1000)]
    async with played(replace(record, frames=lambda: iter(frames)), clock) as (app, press):
        app.player.seek(900)
        shown = await press("3")
        clock.advance(10.0)
        assert "load –" not in shown
        assert "load 0.0 %" not in await press("4")
        rate = app.context.bus.now(clock()).load.frames_per_s
        a_cycle = len(cycles(0, 8)) / 8
        assert rate == pytest.approx(a_cycle * 400, rel=0.01)
