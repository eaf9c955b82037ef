"""Traces where room is short: those that are shown can be read, and where none can, that is said."""

import pytest

from canarm_protocol.cell.cell_file import load_cell
from canarm_tui import DashboardApp
from canarm_tui.outcome import Outcome
from canarm_tui.trace import Trace
from canarm_tui.traces import SHARING_TRACES, heights_of
from tests.tui.screens import screen_lines
from tests.tui.synthetic_bench import SyntheticBench

LEAST = 3
"""Rows of plot: a row for the line, one for each limit."""
NO_ROOM = "no room for traces here"


@pytest.mark.parametrize("room", range(40))
@pytest.mark.parametrize("count", [1, 2, 3])
def test_traces_fill_the_room_alike_and_each_has_three_rows_of_plot(count, room):
    heights = heights_of(count, room)
    assert sum(heights) == (room if heights else 0)
    plots = [height - 1 for height in heights[:-1]] + [height - 2 for height in heights[-1:]]
    assert all(plot >= LEAST for plot in plots)
    assert max(plots, default=0) - min(plots, default=0) <= 1
    further = len(heights) + 1
    assert len(heights) == count or further * (1 + LEAST) + 1 > room, "one more would not fit"


@pytest.mark.parametrize("room", range(12))
def test_many_traces_scroll_and_one_of_them_fits_as_a_whole(room):
    heights = heights_of(SHARING_TRACES + 3, room)
    assert bool(heights) is (room >= 2 + LEAST)
    assert all(2 + LEAST <= height <= room for height in heights)


@pytest.fixture(scope="module")
def run_frames():
    bench = SyntheticBench(load_cell("konkuk1"))
    return [frame for cycle in range(800) for frame in bench.frames(cycle)]


async def test_lines_that_come_above_leave_fewer_traces_the_chosen_one_among_them(cell, port, clock, run_frames):
    port.arriving = list(run_frames)
    ended = []
    app = DashboardApp(
        *(cell, lambda: port),
        clock_ns=clock,
        in_background=lambda job: job(),
        outcome_of=lambda: ended[0] if ended else None,
    )
    async with app.run_test(size=(80, 24)) as pilot:

        async def titles(*keys):
            await pilot.press(*keys)
            for _ in range(3):
                app.drain()
                app.redraw()
                await pilot.pause()
            traces = [trace for trace in app.query(Trace) if trace.region]
            lines = screen_lines(app)
            for trace in traces:
                rows = lines[trace.region.y : trace.region.bottom]
                assert sum("│" in row[:8] for row in rows) >= LEAST, rows
            assert not traces or any("╵" in line for line in lines), "times below"
            return [trace.id.split("-")[1] for trace in traces]

        assert await titles() == ["joint2", "joint3"]
        ended.append(Outcome("FAILED: konkuk1", False, [f"line {number}" for number in range(20)]))
        assert await titles() == ["joint2", "joint3"]
        await pilot.resize_terminal(80, 22)
        assert await titles() == ["joint2"]
        assert await titles("down") == ["joint3"]
        await pilot.resize_terminal(80, 16)
        assert await titles() == []
        assert any(NO_ROOM in line for line in screen_lines(app))
        await pilot.resize_terminal(80, 30)
        assert not any(NO_ROOM in line for line in screen_lines(app))
