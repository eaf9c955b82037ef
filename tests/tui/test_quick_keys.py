"""Keys that come faster than screens go: a dialog ends once, and answers that come for it later are dropped."""

import pytest
from textual.events import Key
from textual.screen import Screen

from canarm_tui import DashboardApp
from canarm_tui.bus.frame_screen import FrameScreen
from canarm_tui.bus.sdo_screen import SdoScreen
from canarm_tui.dialog import Dialog, EndsOnce
from canarm_tui.fault_screens import ClearScreen, LeaveScreen, QuestionScreen, ResetScreen, StopScreen
from canarm_tui.help import HelpScreen
from canarm_tui.inject_screen import InjectScreen
from canarm_tui.run_again import AgainScreen
from canarm_tui.steady import Palette
from canarm_tui.view_registry import VIEWS


@pytest.fixture
def app(cell, loop, clock):
    return DashboardApp(cell, lambda: loop, clock_ns=clock, in_background=lambda job: job())


def press(app, *keys):
    """What a key that is held does: the next comes before the first has had its effect."""
    for key in keys:
        app.simulate_key(key)


async def test_a_question_that_is_answered_several_times_at_once_is_answered_once(app):
    async with app.run_test() as pilot:
        for key in ("y", "enter", "n", "escape"):
            answers = []
            app.push_screen(StopScreen(), answers.append)
            await pilot.pause()
            press(app, key, key, key, key)
            await pilot.pause()
            assert answers == [key in ("y", "enter")]
            assert len(app.screen_stack) == 1


async def test_a_held_key_of_reset_resets_and_the_dashboard_goes_on(app):
    async with app.run_test() as pilot:
        press(app, *"RRRRRRRR")
        await pilot.pause()
        assert app.is_running


async def test_a_key_that_comes_when_the_last_screen_has_gone_does_nothing(app):
    async with app.run_test():
        pass
    assert not app.screen_stack
    await app.on_event(Key("q", "q"))


def dialogs(app):
    return (
        *(ClearScreen(("one",)), ResetScreen(), StopScreen(), LeaveScreen(True), HelpScreen(VIEWS)),
        *(InjectScreen(app.desk), SdoScreen(app.context.bus, 1)),
    )


async def test_a_dialog_that_is_dismissed_twice_ends_once(app):
    async with app.run_test() as pilot:
        for screen in dialogs(app):
            ends = []
            app.push_screen(screen, ends.append)
            await pilot.pause()
            screen.dismiss()
            screen.dismiss()
            await pilot.pause()
            assert ends == [None], screen
            assert len(app.screen_stack) == 1


def test_every_dialog_ends_once():
    for each in (FrameScreen, AgainScreen, QuestionScreen, SdoScreen, InjectScreen, HelpScreen, ClearScreen):
        assert issubclass(each, Dialog)
        assert each.dismiss is EndsOnce.dismiss is not Screen.dismiss


async def test_a_dialog_beneath_another_one_ends_after_it_and_not_in_its_place(app):
    ends = []
    async with app.run_test() as pilot:
        app.push_screen(below := InjectScreen(app.desk), ends.append)
        app.push_screen(above := StopScreen(), ends.append)
        await pilot.pause()
        below.dismiss("accepted")
        await pilot.pause()
        assert app.screen is above
        above.dismiss(False)
        await pilot.pause()
        assert ends == [False, "accepted"]
        assert len(app.screen_stack) == 1


async def test_what_the_bench_can_inject_may_come_when_the_dialog_is_being_closed(app, loop):
    async with app.run_test() as pilot:
        catalogues = []
        app.desk.load_catalogue = catalogues.append
        app.push_screen(screen := InjectScreen(app.desk))
        await pilot.pause()
        await screen.query("#dialog").remove()  # its widgets go while it is still attached
        screen.dismiss()
        assert screen.is_attached
        catalogues[0](())
        await pilot.pause()
        catalogues[0](())
        assert len(app.screen_stack) == 1


async def test_an_object_that_is_read_may_come_when_its_screen_is_closed(app):
    async with app.run_test() as pilot:
        waiting = []
        app.context.bus.desk.read = lambda *question: waiting.append(question[-1])
        app.push_screen(screen := SdoScreen(app.context.bus, 1))
        await pilot.pause()
        await pilot.press("enter")
        screen.dismiss()
        await pilot.pause()
        said = screen.said
        waiting[0](None)
        assert screen.said == said


async def test_the_palette_may_be_closed_as_soon_as_it_is_open(app):
    async with app.run_test() as pilot:
        for _ in range(5):
            press(app, "ctrl+p", "escape")
            await pilot.pause()
            press(app, "ctrl+p", "a", "escape", "escape")
            await pilot.pause()
        assert app.is_running
        assert len(app.screen_stack) == 1


async def test_commands_found_for_a_palette_that_is_closed_are_dropped(app):
    async with app.run_test() as pilot:
        await pilot.press("ctrl+p")
        palette = app.screen
        assert isinstance(palette, Palette)
        palette.dismiss()
        await pilot.pause()
        palette._refresh_command_list(None, [], False)
        palette._list_visible = not palette._list_visible
        palette._show_busy = not palette._show_busy
        assert palette._gather_commands("a") is None
        await pilot.pause()
        assert app.is_running
