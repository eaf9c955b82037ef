"""The view of the joints by its keys, at four sizes, on the frames of a synthetic run of 12 s."""

import pytest

from canarm_tui import DashboardApp
from canarm_tui.arm_picture import ArmPicture
from canarm_tui.joints_view import JointsPane
from canarm_tui.trace import Trace
from tests.tui.synthetic_bench import SyntheticBench

SIZES = [(80, 24), (120, 35), (160, 48), (200, 60)]
CYCLES = 4800


@pytest.fixture(scope="module")
def run_frames():
    from canarm_protocol.cell.cell_file import load_cell

    bench = SyntheticBench(load_cell("konkuk1"))
    return [frame for cycle in range(CYCLES) for frame in bench.frames(cycle)]


@pytest.fixture
def app(cell, port, clock, run_frames):
    port.arriving = list(run_frames)
    return DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job())


def titles(app):
    return [trace.render_line(0).text.strip() for trace in app.query(Trace) if trace.region]


def screen_text(app):
    return ["".join(segment.text for segment in strip) for strip in app.screen._compositor.render_strips()]


def pane(app):
    return app.query_one(JointsPane)


@pytest.mark.parametrize(
    ("size", "signals", "has_picture"),
    [(SIZES[0], 1, False), (SIZES[1], 1, True), (SIZES[2], 2, True), (SIZES[3], 3, True)],
)
async def test_the_wider_the_terminal_the_more_is_shown_at_once(app, size, signals, has_picture):
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        names = ["error", "angle", "current"][:signals]
        assert [title.split(" │ ")[0].split(" +")[0].split(" −")[0] for title in titles(app)] == [
            f"{joint} {name}{unit}"
            for joint in ("joint2", "joint3")
            for name, unit in zip(names, ["", " °", " A"], strict=False)
        ]
        assert bool(app.query_one(ArmPicture).region) is has_picture
        lines = screen_text(app)
        assert any("╵4 s" in line or "╵5 s" in line for line in lines)
        assert all(len(line) == size[0] for line in lines)
        assert any(0x2801 <= ord(letter) <= 0x28FF for line in lines for letter in line)


async def test_traces_and_picture_take_turns_where_there_is_no_room_for_both(app):
    async with app.run_test(size=SIZES[0]) as pilot:
        await pilot.press("p")
        assert app.query_one(ArmPicture).region
        assert not titles(app)
        assert any("side view x–y │ tip" in line for line in screen_text(app))
        await pilot.press("p")
        assert not app.query_one(ArmPicture).region
        assert len(titles(app)) == 2
        await pilot.resize_terminal(*SIZES[1])
        await pilot.press("p")
        assert not app.query_one(ArmPicture).region, "with room for both, the traces get all of it"


async def test_a_key_goes_through_the_signals_and_another_one_back(app):
    async with app.run_test(size=SIZES[1]) as pilot:
        seen = [titles(app)[0].split(" │ ")[0].split()[1]]
        for _ in range(5):
            await pilot.press("t")
            seen.append(titles(app)[0].split(" │ ")[0].split()[1])
        assert seen == ["error", "angle", "current", "speed", "law", "error"]
        await pilot.press("T")
        assert titles(app)[0].startswith("joint2 law value 1")
        await pilot.press("t")
        await pilot.press("t", "t")
        assert "━ motor" in titles(app)[0]
        assert "┄ cmd" in titles(app)[0]
        assert any("+1.5│" in line for line in screen_text(app)), "the amplifier's limit is 1.5 A"


async def test_the_cursor_gives_values_where_it_stands_and_is_moved_by_arrows_and_clicks(app, cell):
    bench = SyntheticBench(cell)
    async with app.run_test(size=SIZES[1]) as pilot:
        await pilot.press("c")
        at = pane(app).timeline.cursor
        assert titles(app)[0].endswith(f" │ ┃ {at * 0.0025:.3f} s")
        shown = at - at % 4  # telemetry comes every fourth cycle
        value = f"{bench.error_lsb(0, shown):+.2f}".replace("-", "−")
        assert f"true − reference {value}" in titles(app)[0]
        await pilot.press("left", "left")
        assert pane(app).timeline.cursor == at - 80
        await pilot.press("right")
        assert pane(app).timeline.cursor == at - 40
        trace = app.query_one("#trace-joint2-0", Trace)
        await pilot.click(trace, offset=(trace.size.width - 1, 3))
        assert pane(app).timeline.cursor == pytest.approx(CYCLES, abs=100)
        await pilot.press("c")
        assert pane(app).timeline.cursor is None


async def test_one_scrolls_back_through_what_is_kept_while_the_run_goes_on(app, port, cell):
    bench = SyntheticBench(cell)
    async with app.run_test(size=SIZES[1]) as pilot:
        await pilot.press("left", "left")
        end = pane(app).timeline.end
        assert end is not None
        for cycle in range(CYCLES + 400):
            frames = bench.frames(cycle)
            if cycle >= CYCLES:
                port.arriving += frames
        app.drain()
        app.redraw()
        assert pane(app).timeline.end == end
        await pilot.press("end")
        assert pane(app).timeline.end is None
        await pilot.press("home")
        assert pane(app).timeline.bounds(pane(app)._extent)[0] == 0
        span = pane(app).timeline.span
        await pilot.press("plus")
        assert pane(app).timeline.span == span // 2
        await pilot.press("minus", "minus")
        assert pane(app).timeline.span > span
        await pilot.press("pagedown", "pagedown")
        assert pane(app).timeline.end is None


async def test_a_paused_view_can_still_be_searched(app):
    async with app.run_test(size=SIZES[1]) as pilot:
        await pilot.press("space", "t", "c")
        assert titles(app)[0].endswith(" s")


async def test_two_joints_are_shown_over_each_other(app):
    async with app.run_test(size=SIZES[1]) as pilot:
        await pilot.press("o")
        assert [title.split(" │ ")[0] for title in titles(app)] == ["error LSB"]
        assert "━ joint2" in titles(app)[0]
        assert "┄ joint3" in titles(app)[0]
        await pilot.press("down")
        assert "━ joint3" in titles(app)[0]
        await pilot.press("o")
        assert len(titles(app)) == 2


async def test_the_laws_own_values_have_names_as_soon_as_they_are_known(app):
    async with app.run_test(size=SIZES[1]) as pilot:
        assert any("law value 1" in line for line in screen_text(app))
        app.feed.internal_names = ("alpha", "[red]beta\x1b[2J" + "x" * 300)
        app.redraw()
        await pilot.pause()
        assert any("alpha" in line for line in screen_text(app))
        await pilot.press("a")
        await pilot.pause()
        lines = screen_text(app)
        assert any("[red]b" in line for line in lines), "a name is text, whatever is in it"
        assert not any("\x1b" in line for line in lines)
        await pilot.press("a")
        assert pane(app)._inner == 0
