"""The line of keys: the most important ones are always whole, and what has no room is left out, not cut off."""

import pytest

from canarm_tui import DashboardApp
from canarm_tui.keys_line import KeysLine
from tests.tui.screens import screen_lines


@pytest.fixture
def app(cell, loop, clock):
    return DashboardApp(cell, lambda: loop, clock_ns=clock, in_background=lambda job: job())


def shown(app):
    """The keys by what they do, and the columns that they take."""
    keys = app.query_one(KeysLine).children
    return {key.description: key.region for key in keys}


async def test_the_most_important_keys_are_whole_in_every_view(app):
    async with app.run_test(size=(80, 24)) as pilot:
        for view in "123456":
            await pilot.press(view)
            await pilot.pause()
            line = screen_lines(app)[-1]
            for key in ("? Help", "q Quit", "f Inject", "e Stop!"):
                assert key in line, (view, key)
            assert all(region.right <= 80 for region in shown(app).values()), view


@pytest.mark.parametrize("width", [40, 60])
async def test_a_narrower_line_leaves_out_more_and_a_wider_one_has_all(app, width):
    async with app.run_test(size=(160, 24)) as pilot:
        await pilot.pause()
        everything = list(shown(app))
        await pilot.resize_terminal(width, 24)
        await pilot.pause()
        fewer = shown(app)
        assert 3 <= len(fewer) < len(everything)
        assert {"Help", "Quit", "Inject"} <= set(fewer)
        assert all(region.right <= width for region in fewer.values())
        assert list(fewer) == [each for each in everything if each in fewer], "in their order"
        await pilot.resize_terminal(160, 24)
        await pilot.pause()
        assert list(shown(app)) == everything
