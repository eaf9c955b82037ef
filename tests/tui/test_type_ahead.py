"""Keys that are typed ahead of dialogs and fields: each means what it would have meant if its user had waited."""

import contextlib
import json

import pytest
from textual.events import Key
from textual.widgets import Input

from canarm_tui import DashboardApp
from canarm_tui.bus.hand import HandState
from canarm_tui.bus.sdo_screen import SdoScreen
from canarm_tui.fault_screens import ClearScreen
from canarm_tui.inject_screen import InjectScreen
from canarm_tui.outcome import Outcome
from canarm_tui.run_again import AgainScreen
from canarm_tui.steady import Palette
from tests.tui.bus.test_cards_view import NotedHand
from tests.tui.test_run_again import Runs

NAMES = {" ": "space", ".": "full_stop"}
TACHOMETER = (*"2 tacho", "enter", *"stuck", "enter", *"2.5", "enter")


@pytest.fixture
def hand():
    return NotedHand()


@pytest.fixture
def app(cell, loop, clock, hand):
    return DashboardApp(cell, lambda: loop, clock_ns=clock, in_background=lambda job: job(), hand=hand)


@contextlib.asynccontextmanager
async def typing(app, loop, clock):
    async with app.run_test(size=(120, 40)) as pilot:

        async def answered():
            """The bench has answered what it was asked."""
            for _ in range(6):
                clock.advance(0.1)
                loop.telemetry()
                app.drain()
                await pilot.pause()

        async def type_ahead(*keys):
            """All keys are there before the first of them has had any effect."""
            for key in keys:
                app.post_message(Key(NAMES.get(key, key), key if len(key) == 1 else None))
            await pilot.pause()
            while app.type_ahead.is_busy:
                await pilot.pause()

        await answered()
        yield type_ahead, answered


def slowly(app):
    """The bench's answer to what can be injected comes when the function that is returned is called."""
    load, waiting = app.desk.load_catalogue, []
    app.desk.load_catalogue = waiting.append
    return lambda: load(waiting.pop())


def stopped(app):
    return app.feed.faults.is_stopped


async def test_letters_behind_f_are_looked_for_and_e_among_them_stops_nothing(app, loop, clock):
    async with typing(app, loop, clock) as (type_ahead, answered):
        answer = slowly(app)
        await type_ahead("f", *"fault there")
        assert isinstance(app.screen, InjectScreen)
        assert "asking the bench" in str(app.screen.query_one("#said").content)
        assert app.screen.query_one("#search", Input).value == "fault there"
        answer()
        await answered()
        assert not stopped(app)
        assert app.screen.query_one("#search", Input).value == "fault there"


async def test_a_fault_is_injected_by_keys_that_are_all_there_before_the_bench_has_answered(app, loop, clock):
    async with typing(app, loop, clock) as (type_ahead, answered):
        answer = slowly(app)
        await type_ahead("f", *TACHOMETER)
        assert app.screen.query_one("#search", Input).value == "2 tacho"
        answer()
        await answered()
        await answered()
        assert loop.bench.device.faults.active == 1
        assert len(app.screen_stack) == 1
        assert not stopped(app)


async def test_escape_leaves_a_dialog_whose_bench_does_not_answer_and_what_was_typed_is_forgotten(app, loop, clock):
    async with typing(app, loop, clock) as (type_ahead, answered):
        slowly(app)
        await type_ahead("f", *"stuck", "enter", *"eeee")
        assert isinstance(app.screen, InjectScreen)
        await type_ahead("escape")
        await type_ahead("2")
        assert len(app.screen_stack) == 1
        assert app.view.name == "events"
        await answered()
        assert not stopped(app)


async def test_the_emergency_stop_does_not_wait_for_a_dialog(app, loop, clock):
    async with typing(app, loop, clock) as (type_ahead, answered):
        await type_ahead("f", *"tacho", "enter", "ctrl+e")
        await answered()
        assert stopped(app)


async def test_e_is_the_emergency_stop_in_a_dialog_without_a_field(app, loop, clock):
    async with typing(app, loop, clock) as (type_ahead, answered):
        await type_ahead("R", "e")
        await answered()
        assert stopped(app)


async def test_the_set_that_was_chosen_ahead_is_the_one_that_is_cleared(app, loop, clock):
    for name in ("first", "second"):
        text = f'[[set]]\nname = "{name}"\n[[set.fault]]\ntap = "joint2.tachometer"\nfault = "stuck"\n'
        loop.bench.device.faults.write(text.encode(), 2)
    async with typing(app, loop, clock) as (type_ahead, answered):
        for _ in range(6):
            await answered()
        await type_ahead("x", "down", "down", "enter")
        assert not isinstance(app.screen, ClearScreen)
        await answered()
        assert [each["set"] for each in json.loads(loop.bench.device.faults.status())["sets"]] == ["first"]


async def test_a_law_is_typed_ahead_behind_r(cell, loop, clock):
    runs = Runs()
    app = DashboardApp(
        cell, lambda: loop, clock_ns=clock, in_background=lambda job: job(), again=runs,
        outcome_of=lambda: Outcome("DONE", True),
    )  # fmt: skip
    async with typing(app, loop, clock) as (type_ahead, answered):
        await type_ahead("r", "end", "backspace", "e", "e")
        assert isinstance(app.screen, AgainScreen)
        assert app.focused.value == "pee"
        await answered()
        assert not stopped(app)


async def test_the_cards_are_taken_in_hand_and_driven_by_keys_typed_ahead(app, loop, clock, hand):
    async with typing(app, loop, clock) as (type_ahead, answered):
        await type_ahead("5", "t", "y", "home", "plus")
        assert hand.state is HandState.READY
        assert hand.told == ["dac joint2 1"]
        await type_ahead("j", *"release", "enter")
        assert hand.told[-1] == "release"
        await answered()
        assert not stopped(app)


@pytest.mark.parametrize(
    ("keys", "field"),
    [
        (("2", "slash"), "#pane-events Input"),
        (("3", "slash"), "#pane-bus Input"),
        (("ctrl+p",), "Input"),
    ],
    ids=["events", "bus", "palette"],
)
async def test_words_typed_ahead_are_in_the_field(app, loop, clock, keys, field):
    async with typing(app, loop, clock) as (type_ahead, answered):
        await type_ahead(*keys, *"the reset")
        assert app.screen.query_one(field, Input).value == "the reset"
        await answered()
        assert not stopped(app)
        assert isinstance(app.screen, Palette) is (keys == ("ctrl+p",))


async def test_objects_are_found_by_words_typed_ahead(app, loop, clock):
    async with typing(app, loop, clock) as (type_ahead, answered):
        app.push_screen(SdoScreen(app.context.bus, 1))
        await type_ahead("slash", *"device")
        assert app.screen.query_one("#sdo-find", Input).value == "device"
        await answered()
        assert not stopped(app)


async def test_the_warning_that_no_run_goes_on_ends_with_the_run_that_begins(app, loop, clock, wire):
    async with typing(app, loop, clock) as (type_ahead, answered):
        await type_ahead("f")
        await answered()
        assert "no run goes on" in str(app.screen.query_one("#said").content)
        app.feed.receive(wire.report(8, 0, 2), clock())
        app.redraw()
        assert str(app.screen.query_one("#said").content) == ""
