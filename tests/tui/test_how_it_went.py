"""All of the summary, in its dialog: the keys that the panel offers work from there too."""

import pytest

from canarm_tui import DashboardApp
from canarm_tui.fault_screens import LeaveScreen
from canarm_tui.outcome import Outcome, OutcomeScreen
from canarm_tui.run_again import AgainScreen
from tests.tui.test_run_again import Runs


@pytest.fixture
def app(cell, clock, port):
    return DashboardApp(
        *(cell, lambda: port),
        clock_ns=clock,
        in_background=lambda job: job(),
        outcome_of=lambda: Outcome("DONE: konkuk1", True, ["recorded in run"]),
        again=Runs(),
    )


@pytest.mark.parametrize(("key", "screen"), [("r", AgainScreen), ("Q", LeaveScreen)])
async def test_r_and_Q_do_what_they_say_while_how_it_went_is_open(app, key, screen):
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("h")
        assert isinstance(app.screen, OutcomeScreen)
        await pilot.press(key)
        await pilot.pause()
        assert isinstance(app.screen, screen)
        await pilot.press("escape")
        await pilot.pause()
        assert len(app.screen_stack) == 1


async def test_q_leaves_while_how_it_went_is_open(app):
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("h", "q")
        await pilot.pause()
        assert not app.is_running
