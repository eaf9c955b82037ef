"""Faults as the dashboard's user meets them: keys in, a real bench in this process, the screen out."""

import contextlib

import pytest
from textual.widgets import Input, OptionList, Static

from canarm_tui import DashboardApp
from canarm_tui.fault_catalogue import SCHEDULE
from canarm_tui.fault_screens import ClearScreen, ResetScreen, StopScreen
from canarm_tui.inject_screen import InjectScreen
from canarm_tui.outcome import Outcome
from canarm_tui.run_controls import LEFT, STOPPED
from canarm_tui.widgets import FaultPanel, WordLine

SMALL, WIDE = (80, 24), (120, 36)


@pytest.fixture
def app(cell, loop, clock):
    return DashboardApp(cell, lambda: loop, clock_ns=clock, in_background=lambda job: job())


@contextlib.asynccontextmanager
async def running(app, loop, clock, size=SMALL):
    async with app.run_test(size=size) as pilot:

        async def shown(seconds=1.0):
            """What the timers do within a second."""
            for _ in range(4):
                clock.advance(seconds / 4)
                loop.telemetry()
                app.drain()
            await pilot.pause()  # a dialog that an answer has closed hands it on
            app.redraw()
            await pilot.pause()

        async def press(*keys):
            for key in keys:
                await pilot.press(key)
            await shown(0.1)

        async def typed(text):
            await pilot.press(*("space" if sign == " " else "full_stop" if sign == "." else sign for sign in text))
            await shown(0.1)

        await shown()
        pilot.shown, pilot.keys, pilot.typed = shown, press, typed
        yield pilot


def panel(app):
    return [" │ ".join(word.text for word in line) for line in app.screen_stack[0].query_one(FaultPanel).lines]


def line(app, name):
    return " │ ".join(word.text for word in app.screen_stack[0].query_one(f"#{name}", WordLine).words)


def said(app):
    return str(app.screen.query_one("#said", Static).content)


def choices(app):
    options = app.screen.query_one(OptionList)
    return [str(options.get_option_at_index(place).prompt).split()[0] for place in range(options.option_count)]


def screen_text(app):
    return "\n".join("".join(segment.text for segment in strip) for strip in app.screen._compositor.render_strips())


async def to_the_form(pilot):
    await pilot.keys("f")
    await pilot.typed("2 tacho")
    await pilot.keys("enter")
    await pilot.typed("stuck")
    await pilot.keys("enter")


async def test_without_faults_the_panel_takes_no_line(app, loop, clock):
    async with running(app, loop, clock):
        assert panel(app) == []
        assert not app.query_one(FaultPanel).region


async def test_a_fault_is_chosen_by_a_few_letters_and_injected_and_the_panel_shows_it(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await pilot.keys("f")
        assert "joint2.dac.code" in choices(app)
        await pilot.typed("2 tacho")
        assert choices(app)[0] == "joint2.tachometer"
        await pilot.keys("enter")
        assert "stuck" in choices(app)
        await pilot.typed("stuck")
        await pilot.keys("enter")
        text = screen_text(app)
        assert "joint2.tachometer stuck" in text
        assert "0 to 5 V" in text
        await pilot.typed("2.5")
        await pilot.keys("enter")
        assert not isinstance(app.screen, InjectScreen), said(app)
        assert line(app, "notice") == "✓ accepted 'joint2.tachometer stuck'"
        assert loop.bench.device.faults.active == 1
        await pilot.shown()
        assert panel(app)[0] == "▲ 1 fault acts │ begun so far 1"
        assert panel(app)[1].startswith("  ▲ joint2.tachometer stuck, since ")
        assert "▲ joint2.tachometer stuck" in screen_text(app)
        await pilot.shown(8.0)
        assert line(app, "notice") == ""


async def test_what_the_bench_refuses_stands_in_the_dialog_and_can_be_mended(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await to_the_form(pilot)
        await pilot.typed("99")
        await pilot.keys("enter")
        assert "value = 99: must be a number from 0 to 5 V" in said(app)
        assert "must be a number from 0 to 5 V" in " ".join(screen_text(app).split())
        await pilot.keys("backspace", "backspace", "5", "enter")
        assert loop.bench.device.faults.active == 1


@pytest.mark.slow
async def test_a_duration_is_typed_behind_the_parameters(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await to_the_form(pilot)
        await pilot.keys("down")
        assert app.screen.focused.name == "duration"
        await pilot.typed("soon")
        await pilot.keys("enter")
        assert said(app).startswith("duration = 'soon': must be a number of seconds")
        await pilot.keys("up")
        assert app.screen.focused.name == "value"
        assert loop.bench.device.faults.active == 0


@pytest.mark.slow
async def test_defaults_stand_in_the_fields_and_other_faults_have_other_fields(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await to_the_form(pilot)
        await pilot.keys("escape")
        await pilot.typed("noise")
        await pilot.keys("enter")
        fields = {field.name: field.value for field in app.screen.query("#form Input").results(Input)}
        assert "value" not in fields
        assert all(fields[name] for name in set(fields) - set(SCHEDULE))
        assert not any(fields[name] for name in SCHEDULE)


async def test_a_fault_that_waits_is_shown_with_its_trigger_and_begun_by_hand(app, loop, clock):
    async with running(app, loop, clock, WIDE) as pilot:
        await to_the_form(pilot)
        last = app.screen.query("#form Input")[-1]
        last.focus()
        await pilot.typed("yes")
        await pilot.keys("enter")
        await pilot.shown(3.0)
        assert "  ○ waiting: joint2.tachometer stuck (by hand)" in panel(app)
        await pilot.keys("x", "t")
        assert isinstance(app.screen, ClearScreen), "all of them cannot be triggered"
        await pilot.keys("down", "t")
        assert line(app, "notice") == "✓ triggered 'joint2.tachometer stuck'"
        assert loop.bench.device.faults.active == 1


async def test_without_a_run_the_dialog_says_that_the_robot_is_at_rest(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await pilot.keys("f")
        assert "no run goes on" in said(app)


@pytest.mark.slow
async def test_after_a_run_of_a_demo_nothing_is_injected(cell, loop, clock):
    class Runs:
        number, ends_here, folder = 1, True, "run"

    over = []
    app = DashboardApp(
        *(cell, lambda: loop),
        clock_ns=clock,
        in_background=lambda job: job(),
        again=Runs(),
        outcome_of=lambda: over[0] if over else None,
    )
    async with running(app, loop, clock) as pilot:
        await to_the_form(pilot)
        over.append(Outcome("DONE: konkuk1", True))
        await pilot.shown()
        await pilot.keys("enter")
        assert "nobody would detect a fault" in said(app), "it was over while the form was filled in"
        assert loop.bench.device.faults.active == 0
        await pilot.keys("escape", "escape", "escape")
        await pilot.keys("f")
        assert len(app.screen_stack) == 1
        assert "nobody would detect a fault; r runs again" in line(app, "notice")


@pytest.mark.slow
async def test_escape_goes_back_step_by_step(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await to_the_form(pilot)
        await pilot.keys("escape")
        assert "stuck" in choices(app)
        await pilot.keys("escape")
        assert "joint3.link" in choices(app)
        await pilot.keys("escape")
        assert len(app.screen_stack) == 1


@pytest.mark.slow
async def test_the_arrows_choose_from_the_list_while_one_types(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await pilot.keys("f")
        await pilot.typed("tacho")
        await pilot.keys("down", "enter")
        assert "joint3.tachometer: which fault?" in screen_text(app)
        await pilot.keys("escape")
        await pilot.typed("xyzzy")
        assert choices(app) == []
        assert said(app).startswith("nothing is called so")
        await pilot.keys("enter", "down", "up")
        assert app.screen.query_one("#search", Input).has_focus


async def test_keys_typed_into_a_field_are_no_commands(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await pilot.keys("f")
        await pilot.typed("qxef")
        assert isinstance(app.screen, InjectScreen)
        assert app.screen.query_one("#search", Input).value == "qxef"


async def test_without_a_bus_the_dialog_says_so(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        loop.is_broken = True
        app.drain()
        await pilot.press("f")
        app.drain()
        app.drain()
        await pilot.pause()
        assert said(app) == "not connected: -i loop -c bench: the server closed the connection"


async def test_a_dialog_that_is_left_before_the_bench_answers_is_left(cell, loop, clock):
    jobs = []
    app = DashboardApp(cell, lambda: loop, clock_ns=clock, in_background=lambda job: job())
    app.desk._in_background = jobs.append
    async with running(app, loop, clock) as pilot:
        await pilot.keys("f")
        assert said(app).startswith("… asking")
        await pilot.keys("escape")
        while jobs:
            jobs.pop()()
            await pilot.shown(0.1)
        assert len(app.screen_stack) == 1


async def test_one_set_is_cleared_from_a_list_or_all_of_them(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        for name in "abc":
            text = f'[[set]]\nname = "{name}"\n[[set.fault]]\ntap = "joint2.tachometer"\nfault = "stuck"\n'
            loop.bench.device.faults.write(text.encode(), 2)
        await pilot.shown(2.0)
        assert panel(app)[0].startswith("▲ 3 faults act")
        await pilot.keys("x", "down", "down", "enter")
        assert loop.bench.device.faults.active == 2
        assert line(app, "notice").startswith("✓ cleared")
        await pilot.shown()
        assert not any("(b), since" in text for text in panel(app))
        await pilot.keys("x", "enter")
        assert loop.bench.device.faults.active == 0
        await pilot.shown()
        assert panel(app)[0].startswith("no fault acts")
        assert not any(", since" in text for text in panel(app))
        await pilot.keys("x")
        assert isinstance(app.screen, ClearScreen)
        await pilot.keys("escape")
        assert len(app.screen_stack) == 1


async def test_the_emergency_stop_acts_at_once_and_asks_only_before_its_release(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        assert any("Stop!" in text for text in screen_text(app).splitlines()[-1:]), "the key stands in the footer"
        await pilot.keys("e")
        assert loop.bench.device.is_stopped
        assert len(app.screen_stack) == 1
        await pilot.shown()
        assert "■ EMERGENCY STOP" in line(app, "header")
        assert "■ EMERGENCY STOP" in screen_text(app).splitlines()[0]
        await pilot.keys("e")
        assert isinstance(app.screen, StopScreen)
        assert "again?" in screen_text(app)
        await pilot.keys("e", "n")
        assert loop.bench.device.is_stopped
        assert len(app.screen_stack) == 1
        await pilot.keys("e", "y")
        assert not loop.bench.device.is_stopped
        await pilot.shown()
        assert "EMERGENCY" not in line(app, "header")


@pytest.mark.parametrize(
    ("before", "key"),
    [
        (("x",), "e"),
        (("question_mark",), "e"),
        (("R",), "e"),
        (("Q",), "e"),
        (("f",), "ctrl+e"),
        (("ctrl+p",), "ctrl+e"),
        (("2",), "e"),
        (("space",), "e"),
    ],
)
async def test_the_emergency_stop_acts_from_wherever_one_is(app, loop, clock, before, key):
    async with running(app, loop, clock) as pilot:
        await pilot.keys(*before, key)
        assert loop.bench.device.is_stopped


async def test_the_letter_of_the_emergency_stop_can_be_typed_into_a_field(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await pilot.keys("f", "e")
        assert not loop.bench.device.is_stopped
        assert app.screen.query_one("#search").value == "e"


async def test_q_leaves_and_the_capital_one_stops_the_robot_first_and_asks(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await pilot.keys("Q")
        assert "stop what runs?" in screen_text(app)
        await pilot.keys("escape")
        assert not loop.bench.device.is_stopped
        await pilot.keys("Q", "y")
        await pilot.pause()
        assert loop.bench.device.is_stopped
        assert not app.is_running
    assert app.left_by == STOPPED


async def test_who_cannot_be_stopped_is_not_left(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        loop.is_broken = True
        await pilot.keys("Q", "y")
        assert app.is_running
        loop.is_broken = False
        await pilot.keys("q")
        await pilot.pause()
        assert not app.is_running
    assert app.left_by == LEFT


async def test_without_a_demo_r_says_who_starts_a_controller(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await pilot.keys("r")
        assert line(app, "notice").startswith("✖ a controller is started outside: canarm controller")


async def test_capital_r_switches_the_robot_off_and_on_again_and_asks_first(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await pilot.keys("e")
        assert loop.bench.device.is_stopped
        await pilot.keys("R")
        assert isinstance(app.screen, ResetScreen)
        assert "off and on again" in screen_text(app)
        await pilot.keys("escape")
        assert loop.bench.device.is_stopped
        await pilot.keys("R", "R")
        assert line(app, "notice") == "✓ the robot was switched off and on again"
        assert not loop.bench.device.is_stopped
        await pilot.shown()
        assert "EMERGENCY" not in line(app, "header")
        await pilot.keys("question_mark")
        assert "R  reset" in screen_text(app)


@pytest.mark.slow
async def test_the_dialog_fits_a_small_terminal_and_the_largest_form(app, loop, clock):
    async with running(app, loop, clock) as pilot:
        await pilot.keys("f")
        dialog = app.screen.query_one("#dialog").region
        assert dialog.width <= 80
        assert dialog.height <= 24
        await pilot.typed("joint2.link")
        await pilot.keys("enter")
        await pilot.typed("collision")
        await pilot.keys("enter")
        last = list(app.screen.query("#form Input"))[-1]
        last.focus()
        await pilot.pause()
        assert last.region.height == 1
        assert dialog.contains_region(last.region), "the last field cannot be seen"


async def test_the_traces_give_way_to_the_panel_and_all_of_it_is_seen(app, loop, clock):
    async with running(app, loop, clock, WIDE) as pilot:
        for number in range(6):
            text = f'[[set]]\nname = "s{number}"\n[[set.fault]]\ntap = "joint2.tachometer"\nfault = "stuck"\n'
            loop.bench.device.faults.write(text.encode(), 2)
        await pilot.shown(2.0)
        lines = screen_text(app).splitlines()
        for text in panel(app):
            assert any(text in shown for shown in lines), text
        assert "frames" in lines[-2]
