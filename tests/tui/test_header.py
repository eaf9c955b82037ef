"""The header: what a reader looks for first is there at every size, the rest where there is room."""

import math
import re

import pytest

from canarm_controller.bus.assessment import tell_plan
from canarm_protocol.cell.bench_objects import CONTROLLER_CHANNEL, sdo_channel
from canarm_protocol.faults.run_plan import RunPlan
from canarm_protocol.transport.sdo_session import SdoSession
from canarm_tui import DashboardApp
from canarm_tui.header import clock_words, header_words, load_words, time_words
from canarm_tui.link import Link
from canarm_tui.snapshot import BusNow, Rates, Report, Snapshot
from canarm_tui.texts import SEPARATOR
from tests.tui.screens import screen_lines

RUNNING, DONE, HOMING = 2, 4, 6
CYCLE_S = 0.0025
AT_FULL_SPEED = Rates(400.0, 400.0, 1.0)
DEMO = "-i canarm -c bench host=127.0.0.1 port=40409"


@pytest.fixture
def link(port):
    link = Link(lambda: port, "-i fake -c bench", in_background=lambda job: job())
    link.poll(0)
    link.where = DEMO
    return link


def run(late=0, **others):
    return Snapshot(
        *((),), age_ns=0, rates=AT_FULL_SPEED, report=Report(4920, late, RUNNING, 0), run_ticks=4920, law="mras",
        plan=RunPlan(True, 24000, 1.0), **others
    )  # fmt: skip


def text(*arguments, **options):
    return SEPARATOR.join(word.text for word in header_words(*arguments, **options))


def test_at_80_columns_time_length_pace_record_cell_and_law_come_before_the_address(link, cell):
    """60 s at 400 Hz are 24000 ticks."""
    shown = text(link, run(), False, 78, cell, (True, "runs/a"))
    assert shown == "● connected │ ▶ running │ 12.3/60 s │ lockstep 1 × │ ● rec │ konkuk1 │ mras"
    late = text(link, run(late=3), False, 78, cell, (True, "runs/a"))
    assert "▲ late+missed 3" in late
    assert "12.3/60 s │ lockstep 1 ×" in late


def test_the_address_is_short_however_much_room_there_is(link, cell):
    assert text(link, run(), False, 400, cell).endswith(" │ konkuk1 │ mras │ 127.0.0.1:40409")
    link.where = "-i udp_multicast -c 239.74.163.2 port=43113 hop_limit=1"
    assert text(link, run(), False, 400, cell).endswith("hop_limit=1"), "what has no short form is whole"


@pytest.mark.parametrize("width", range(20, 220))
def test_no_word_is_cut_and_the_connection_and_the_state_are_always_there(link, cell, width):
    words = header_words(link, run(late=2), False, width, cell, (True, "runs/a"))
    assert [word.text for word in words[:2]] == ["● connected", "▶ running"]
    if width > 30:
        assert len(SEPARATOR.join(word.text for word in words)) <= width
    assert all(word.text in text(link, run(late=2), False, 400, cell, (True, "runs/a")) for word in words)


@pytest.mark.parametrize(
    ("plan", "shown"),
    [
        (None, []),
        (RunPlan(False), ["wall clock"]),
        (RunPlan(True), ["lockstep"]),
        (RunPlan(True, 0, math.inf), ["lockstep max"]),
        (RunPlan(True, 0, 0.25), ["lockstep 0.25 ×"]),
    ],
)
def test_the_clock_and_the_set_pace_are_named(plan, shown):
    assert [word.text for word in clock_words(Snapshot((), plan=plan))] == shown


@pytest.mark.parametrize(
    ("ticks", "length", "shown"),
    [(None, 4000, []), (400, 0, ["1.0 s"]), (400, 4096, ["1.0/10.24 s"]), (4098, 4096, ["10.2/10.24 s"]),
     (9000, 4096, ["22.5 s"])],
)  # fmt: skip
def test_the_time_is_that_of_the_run_and_never_beyond_its_length(ticks, length, shown):
    snapshot = Snapshot((), run_ticks=ticks, plan=RunPlan(True, length))
    assert [word.text for word in time_words(snapshot, CYCLE_S)] == shown


def test_the_load_is_that_of_the_wire_and_ends_with_the_run():
    bus = BusNow(0.15, 0)
    assert [word.text for word in load_words(run(bus=bus))] == ["wire 15 %"]
    over = Snapshot((), bus=bus, rates=AT_FULL_SPEED, report=Report(9, 0, DONE, 0))
    still = Snapshot((), bus=bus)
    assert load_words(over) == load_words(still) == ()


async def test_what_the_controller_has_told_the_bench_is_in_the_header(cell, loop, clock, wire):
    app = DashboardApp(cell, lambda: loop, clock_ns=clock, in_background=lambda job: job())
    async with app.run_test(size=(80, 24)) as pilot:
        tell_plan(SdoSession(loop, *sdo_channel(cell.bus.bench_node_id, CONTROLLER_CHANNEL)), 24000, math.inf)
        for tick, state in ((0, HOMING), (800, HOMING), (1600, RUNNING), (2000, RUNNING)):
            app.feed.receive(wire.report(tick, 0, state), clock())
            for _ in range(4):
                clock.advance(0.1)
                loop.telemetry()
                app.drain()
        app.redraw()
        await pilot.pause()
        assert re.search(r"1\.0/60 s │ (lockstep max|wall clock)", screen_lines(app)[0]), "homing does not count"
