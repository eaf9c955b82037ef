"""A controller or a bench that is lost in the middle of a run is a state that is shown, over a real bench in this
process.
"""

import contextlib

import pytest

from canarm_protocol.canopen.frames import NmtCommand, nmt_frame, sync_frame
from canarm_protocol.faults.detection_events import DetectionEvent, pieces_of
from canarm_tui import DashboardApp
from canarm_tui.feed import Feed
from tests.tui.screens import screen_lines

S = 1_000_000_000
RUNNING, STOPPING, DONE = 2, 3, 4


class Disk:
    is_on, place, failure = True, "/runs/7", None

    def switch(self, is_on):
        self.is_on = is_on


@pytest.fixture
def bench(loop):
    """A bench that records, and has been told of a detection in cycle 1."""
    disk = Disk()
    loop.bench.device.run.attach(disk, disk.switch)
    loop.bench.receive(nmt_frame(NmtCommand.START), "controller")
    loop.bench.receive(sync_frame(1), "controller")
    for piece in pieces_of(DetectionEvent(1, "encoder-lost", "joint2", "no pulses for 20 ms", "substitute")):
        loop.bench.device.detections.take(piece)
    return loop


@contextlib.asynccontextmanager
async def watching(cell, bench, clock, wire, state=RUNNING):
    def open_port():
        bench._check()
        return bench

    app = DashboardApp(cell, open_port, clock_ns=clock, in_background=lambda job: job())
    async with app.run_test(size=(120, 30)) as pilot:

        async def shown(seconds):
            for _ in range(10):
                clock.advance(seconds / 10)
                if not bench.is_broken:
                    bench.telemetry()
                app.drain()
            app.redraw()
            await pilot.pause()
            return screen_lines(app)

        await shown(1.0)
        app.feed.receive(wire.report(8, 0, state), clock())
        yield app, shown


async def test_a_controller_that_was_killed_leaves_verdict_reason_detections_and_folder(cell, bench, clock, wire):
    async with watching(cell, bench, clock, wire) as (app, shown):
        assert not any("LOST" in line for line in await shown(0.9))
        lines = await shown(3.0)
        assert "✖ controller lost" in lines[0]
        text = "\n".join(lines)
        assert "✖ LOST: the controller has fallen silent; it was killed, or hangs │ q leaves" in text
        assert "its last report is of cycle 8, 4 s ago" in text
        assert "recorded in /runs/7" in text
        assert "◆ detected: encoder-lost at joint2 │ substitute │ no pulses for 20 ms" in text
        app.action_pane("events")
        assert any("▸ controller lost: no report since cycle 8" in line for line in await shown(0.3))


async def test_it_stays_lost_when_the_bench_goes_too_and_until_a_controller_reports(cell, bench, clock, wire):
    async with watching(cell, bench, clock, wire) as (app, shown):
        await shown(3.0)
        bench.is_broken = True
        lines = await shown(3.0)
        assert "✖ controller lost" in lines[0]
        assert "running" not in lines[0]
        text = "\n".join(lines)
        assert "✖ LOST: the controller" in text
        assert "then the bench was lost: -i loop -c bench: the server closed the connection" in text
        bench.is_broken = False
        await shown(3.0)
        app.feed.receive(wire.report(8, 0, RUNNING), clock())
        assert not any("LOST" in line for line in await shown(0.3))


async def test_a_bench_that_is_lost_in_a_run_leaves_verdict_reason_and_folder(cell, bench, clock, wire):
    async with watching(cell, bench, clock, wire) as (_, shown):
        await shown(0.3)
        bench.is_broken = True
        text = "\n".join(await shown(3.0))
        assert "✖ LOST: the bench, in the middle of a run │ q leaves" in text
        assert "-i loop -c bench: the server closed the connection" in text
        assert "recorded in /runs/7" in text


async def test_a_bench_that_goes_after_the_end_of_a_run_loses_none(cell, bench, clock, wire):
    async with watching(cell, bench, clock, wire, DONE) as (_, shown):
        bench.is_broken = True
        assert not any("LOST" in line for line in await shown(3.0))


def test_a_controller_in_its_safe_stop_is_not_lost(cell, wire):
    """It waits for standstill for up to 2 s, 800 cycles, and reports when that is over."""
    feed = Feed(cell)
    feed.receive(wire.telemetry(400) + wire.report(400, 0, STOPPING), 0)
    for cycle in range(404, 1204, 4):
        feed.receive(wire.telemetry(cycle), cycle * 2_500_000 - S)
        assert not feed.snapshot(cycle * 2_500_000 - S).report.is_lost
    for cycle in range(1204, 2000, 4):
        feed.receive(wire.telemetry(cycle), cycle * 2_500_000 - S)
    assert feed.snapshot(4 * S).report.is_lost, "killed in its stop"
