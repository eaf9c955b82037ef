"""The end of a run that others have started, and its record, over a real bench in this process."""

import contextlib

import pytest

from canarm_controller.bus.assessment import tell_outcome
from canarm_protocol.canopen.frames import NmtCommand, nmt_frame, sync_frame
from canarm_protocol.cell.bench_objects import CONTROLLER_CHANNEL, OUTCOME, sdo_channel
from canarm_protocol.faults.detection_events import DetectionEvent, pieces_of
from canarm_protocol.transport.sdo_session import SdoSession
from canarm_tui import DashboardApp
from tests.tui.screens import screen_lines

RUNNING, DONE, FAILED = 2, 4, 5
SAID = ["FAILED: konkuk1, mras on sine", "tachometer-stuck at joint2: 0.0 V", "recorded in /runs/7", "4096 cycles"]


@contextlib.asynccontextmanager
async def watching(cell, loop, clock, size=(120, 30)):
    app = DashboardApp(cell, lambda: loop, clock_ns=clock, in_background=lambda job: job())
    async with app.run_test(size=size) as pilot:

        async def press(*keys):
            await pilot.press(*keys)
            for _ in range(6):
                clock.advance(0.6)
                loop.telemetry()
                app.drain()
            app.redraw()
            await pilot.pause()
            return "\n".join(screen_lines(app))

        await press()
        yield app, press


def session(cell, loop):
    return SdoSession(loop, *sdo_channel(cell.bus.bench_node_id, CONTROLLER_CHANNEL))


@pytest.fixture
def report(cell, loop, wire):
    def send(app, clock, tick, state):
        frames = wire.report(tick, 0, state)
        loop.bench.receive_bench(frames[0][1], "controller")
        app.feed.receive(frames, clock())

    return send


async def test_the_verdict_and_the_reason_are_what_the_controller_has_told_the_bench(cell, loop, clock, report):
    async with watching(cell, loop, clock) as (app, press):
        report(app, clock, 400, RUNNING)
        assert "FAILED" not in await press()
        report(app, clock, 800, FAILED)
        tell_outcome(session(cell, loop), SAID)
        shown = await press()
        assert "✖ FAILED: konkuk1, mras on sine │ q leaves" in shown
        assert "tachometer-stuck at joint2: 0.0 V" in shown
        assert "recorded in /runs/7" in shown
        report(app, clock, 4, RUNNING)
        assert "FAILED" not in await press(), "another run goes on"


async def test_a_controller_that_says_no_word_has_its_last_detection_as_reason(cell, loop, clock, report, wire):
    async with watching(cell, loop, clock) as (app, press):
        loop.bench.receive(nmt_frame(NmtCommand.START), "controller")
        loop.bench.receive(sync_frame(1), "controller")
        report(app, clock, 400, RUNNING)
        found = DetectionEvent(401, "encoder-lost", "joint2", "no pulses for 20 ms", "safe-stop")
        for piece in pieces_of(found):
            loop.bench.device.detections.take(piece)
        loop.telemetry()
        report(app, clock, 402, FAILED)
        shown = await press()
        assert "✖ FAILED │ q leaves" in shown
        assert "encoder-lost: no pulses for 20 ms" in shown
        before = loop.requests.count(OUTCOME)
        await press()
        await press()
        assert loop.requests.count(OUTCOME) <= 6, "it is not asked for ever"
        assert before <= 6


async def test_a_run_that_went_well_says_done(cell, loop, clock, report):
    async with watching(cell, loop, clock) as (app, press):
        report(app, clock, 4096, DONE)
        assert "✓ DONE │ q leaves" in await press()


class Disk:
    is_on, place, failure = True, "/runs/7", None

    def switch(self, is_on):
        self.is_on = is_on


async def test_recording_is_stopped_and_goes_on_by_a_key_and_the_header_says_so(cell, loop, clock):
    disk = Disk()
    loop.bench.device.run.attach(disk, disk.switch)
    async with watching(cell, loop, clock, (160, 48)) as (app, press):
        assert "● rec" in (await press()).splitlines()[0]
        shown = await press("w")
        assert disk.is_on is False
        assert "○ not recorded" in shown.splitlines()[0]
        app.action_record()
        shown = await press()
        assert disk.is_on is True
        assert "● rec" in shown.splitlines()[0]
        assert "✓ recording again in /runs/7" in shown or "● rec" in shown


async def test_where_nothing_is_recorded_the_reason_is_shown(cell, loop, clock):
    async with watching(cell, loop, clock) as (app, press):
        assert "rec" not in (await press()).splitlines()[0].split("loop")[0]
        app.action_record()
        app.drain()
        app.drain()
        app.redraw()
        assert "the emulator was started without --out DIR" in app.answer.text


FIGURES = [
    "DONE: konkuk1, mras on sine, feed-forward table, clock sync",
    "recorded in /home/somebody/canarm/runs/20260301-120000",
    "3200 cycles, 0.974 x real time, 0 missed, 0 late",
    "joint        RMS error   max error  peak current   ripple  amplifier",
    "joint2       0.061 LSB   0.151 LSB       0.794 A        -  within its limit",
    "joint3       0.074 LSB   0.200 LSB       0.329 A        -  within its limit",
]


async def test_the_figures_of_two_joints_fit_the_smallest_terminal(cell, loop, clock, report):
    async with watching(cell, loop, clock, (80, 24)) as (app, press):
        report(app, clock, 3200, DONE)
        tell_outcome(session(cell, loop), FIGURES)
        shown = await press()
        for line in FIGURES:
            assert line in shown
        assert "q leaves" in shown


async def test_before_the_end_there_is_no_summary(cell, loop, clock, report):
    async with watching(cell, loop, clock) as (app, press):
        report(app, clock, 3200, RUNNING)
        app.action_outcome()
        assert "there is no summary yet" in app.answer.text
        assert "there is no summary yet" not in await press(), "the controller was lost meanwhile"
