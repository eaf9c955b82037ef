"""The list of views: keys, tabs, palette and help are made from it."""

import pytest
from textual.binding import Binding
from textual.content import Content

from canarm_tui import DashboardApp
from canarm_tui.help import help_text
from canarm_tui.view_registry import VIEWS


def test_names_and_keys_of_views_are_unlike_each_other_and_unlike_other_keys():
    names, keys = [view.name for view in VIEWS], [view.key for view in VIEWS]
    taken = [binding.key for binding in DashboardApp.BINDINGS if isinstance(binding, Binding)]
    assert len(set(names)) == len(names)
    assert all(taken.count(key) == 1 for key in keys)


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
async def test_a_view_comes_with_its_key_its_tab_and_its_help(cell, port, clock, view):
    app = DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job())
    async with app.run_test(size=(80, 24)) as pilot:
        for other in (VIEWS[0], VIEWS[-1], view):
            await pilot.press(other.key)
        visible = [each.pane_id for each in VIEWS if app.query_one(f"#{each.pane_id}").region]
        assert visible == [view.pane_id]
        screen = ["".join(segment.text for segment in strip) for strip in app.screen._compositor.render_strips()]
        assert any(f"[{view.key} {view.title}]" in line for line in screen)
    said = Content.from_markup(help_text(VIEWS)).plain
    assert f"{view.key}  {view.title}: " in said
    assert f"{view.title}\n  {view.help.splitlines()[0]}" in said


async def test_a_paused_view_stands_still_as_of_the_pause_even_one_that_is_chosen_later(cell, port, clock, wire):
    app = DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job())
    async with app.run_test(size=(120, 36)) as pilot:
        shown = []
        await pilot.press("2")  # until then the timer may draw what there is at first, nothing
        app.query_one("#pane-joints").show = lambda scene: shown.append(scene.snapshot.cycle)
        port.arriving = wire.telemetry(8)
        app.drain()
        app.redraw()
        await pilot.press("space")
        port.arriving = wire.telemetry(12)
        app.drain()
        await pilot.press("1")
        assert set(shown) == {8}
        await pilot.press("space")
        assert shown[-1] == 12
