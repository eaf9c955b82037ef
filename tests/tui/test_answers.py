"""Answers to keys: what failed stands before all else, at once; what holds no more is gone."""

import contextlib

import pytest

from canarm_protocol.errors import BusError
from canarm_tui import DashboardApp, fault_desk
from canarm_tui.answers import ANSWER_NS
from canarm_tui.outcome import Outcome
from tests.tui.screens import screen_lines
from tests.tui.test_run_again import Runs

RUNNING, FAILED = 2, 5
NOBODY = "-i canarm -c bench: nobody listens there; start one with: canarm emulator"


@contextlib.asynccontextmanager
async def shown(cell, open_port, clock, size=(80, 24), **options):
    app = DashboardApp(cell, open_port, clock_ns=clock, in_background=lambda job: job(), **options)
    async with app.run_test(size=size) as pilot:

        async def press(*keys, seconds=0.0):
            await pilot.press(*keys)
            clock.advance(seconds)
            app.drain()
            app.redraw()
            await pilot.pause()
            return "\n".join(screen_lines(app))

        yield app, press


def refuse():
    raise BusError(NOBODY)


@pytest.mark.parametrize("key", ["e", "ctrl+e"])
@pytest.mark.parametrize("dialog", [(), ("question_mark",), ("R",)])
async def test_an_emergency_stop_that_cannot_be_sent_says_so_at_once_and_before_the_reconnecting(
    cell, clock, key, dialog
):
    async with shown(cell, refuse, clock) as (app, press):
        assert "trying again" in await press()
        await press(*dialog, key)
        assert app.answer.text == "✖ emergency stop NOT sent: no bench is connected"
        if dialog:
            app.pop_screen()
        assert "✖ emergency stop NOT sent: no bench is connected" in await press(seconds=4.0)
        assert "trying again" in await press(seconds=ANSWER_NS * 1e-9)


async def test_a_stop_that_nobody_confirms_is_called_unconfirmed(cell, loop, clock, monkeypatch):
    monkeypatch.setattr(fault_desk, "LIMIT_S", 0.01)
    async with shown(cell, lambda: loop, clock) as (_, press):
        await press()
        loop.is_silent = True
        await press("e")
        assert "✖ emergency stop sent, and NOT confirmed: " in await press()


@pytest.mark.parametrize("keys", [("R", "y"), ("w",)])
async def test_whatever_else_needs_a_bench_is_refused_before_the_reconnecting(cell, clock, keys):
    async with shown(cell, refuse, clock) as (_, press):
        await press(*keys)
        assert f"✖ not connected: {NOBODY}"[:70] in await press()


async def test_what_went_well_does_not_hide_that_the_bench_was_lost(cell, loop, clock):
    async with shown(cell, lambda: loop, clock) as (_, press):
        loop.telemetry()
        await press("e")
        assert "✓ emergency stop" in await press()
        loop.is_broken = True
        assert "trying again" in await press()


@pytest.mark.parametrize("key", ["h", "r"])
async def test_a_summary_that_is_not_there_yet_is_on_its_way_and_then_said_no_more(cell, port, wire, clock, key):
    """The processes of a demo end some seconds after the run has."""
    ended = []
    outcome_of = lambda: ended[0] if ended else None  # noqa: E731
    async with shown(cell, lambda: port, clock, outcome_of=outcome_of, again=Runs()) as (_, press):
        port.arriving = wire.telemetry(8) + wire.report(8, 0, RUNNING)
        await press()
        running = await press(key)
        assert "no run has ended" in running or "the run goes on" in running
        port.arriving = wire.report(400, 0, FAILED)
        shown_now = await press()
        assert "no run has ended" not in shown_now
        assert "the run goes on" not in shown_now
        assert "… the summary is on its way" in await press(key)
        ended.append(Outcome("FAILED: konkuk1", False, ["joint2: stuck"]))
        shown_now = await press()
        assert "✖ FAILED: konkuk1" in shown_now
        assert "on its way" not in shown_now
