"""Joints, events and dialogs as they look at four sizes, on a frozen clock; other views have their own."""

import pytest

from canarm_protocol.canopen.frames import Emergency, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.decoding import robot_book
from canarm_tui import DashboardApp
from canarm_tui.bus.watch import BusWatch
from canarm_tui.outcome import Outcome
from canarm_tui.run_again import NextRun
from tests.tui.screens import at_every_size
from tests.tui.synthetic_bench import SyntheticBench

CYCLES = 2400
SUMMARY = [
    "recorded in runs/20260301-120000",
    "3200 cycles, 0.974 x real time, 0 missed, 0 late",
    "joint        RMS error   max error  peak current   ripple  amplifier",
    "joint2       0.061 LSB   0.151 LSB       0.794 A        -  within its limit",
    "joint3       0.074 LSB   0.200 LSB       0.329 A        -  within its limit",
]


@pytest.fixture(scope="module")
def run_frames():
    bench = SyntheticBench(load_cell("konkuk1"))
    return [frame for cycle in range(CYCLES) for frame in bench.frames(cycle)]


class Runs:
    """Runs that could be run again."""

    number, ends_here, folder = 1, True, "runs/20260301-120000"
    last = NextRun("mras", "sine", "0", "1")
    hints = NextRun("pd, mras, slotine-li, or FILE.py:CLASS", "sine, trapezoid, or a file", "a number", "or max")


async def test_the_joints(cell, port, clock, run_frames):
    port.arriving = list(run_frames)
    app = DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job())
    async with app.run_test(size=(80, 24)) as pilot:
        await at_every_size(app, pilot, "joints", "#pane-joints")


async def test_the_events(cell, port, clock, wire):
    robot_bus = type(port)()
    watch = BusWatch(robot_book(cell), lambda: robot_bus, "-i fake -c can0", in_background=lambda job: job())
    app = DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job(), bus=watch)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("2")
        app.drain()
        robot_bus.arriving = [(0, nmt_frame(NmtCommand.START)), *((0, sync_frame(each)) for each in range(1, 100))]
        robot_bus.arriving += [(0, Emergency(0x8130, 0x11).frame(0x14)), (0, nmt_frame(NmtCommand.STOP, 0x12))]
        port.arriving = wire.telemetry(96) + wire.report(0, 0, 6) + wire.report(20, 0, 2) + wire.report(99, 2, 3)
        app.drain()
        clock.advance(0.5)
        await at_every_size(app, pilot, "events", "#pane-events")


async def test_the_form_of_a_fault(cell, loop, clock):
    app = DashboardApp(cell, lambda: loop, clock_ns=clock, in_background=lambda job: job())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("f")
        for _ in range(2):
            app.drain()
        await pilot.press(*"tacho", "enter", *"stuck", "enter")
        await pilot.pause()
        await at_every_size(app, pilot, "inject")


async def test_the_end_of_a_run_and_how_to_run_again(cell, port, clock, wire):
    outcome = Outcome("DONE: konkuk1, mras on sine, feed-forward table, clock sync", True, SUMMARY)
    app = DashboardApp(
        *(cell, lambda: port),
        clock_ns=clock,
        in_background=lambda job: job(),
        outcome_of=lambda: outcome,
        again=Runs(),
    )
    async with app.run_test(size=(80, 24)) as pilot:
        port.arriving = wire.telemetry(3200)
        app.drain()
        await at_every_size(app, pilot, "outcome", "#outcome")
        for key, name in (("h", "summary"), ("r", "again"), ("Q", "leave")):
            await pilot.press(key)
            await pilot.pause()
            await at_every_size(app, pilot, name)
            await pilot.press("escape")
            await pilot.pause()
