"""A recorded run plays as a live one would: a synthetic history of 20 s, a fault from 5 to 10 s, seen at 5.1 s."""

from dataclasses import replace

import numpy as np
import pytest

from canarm_protocol.canopen.frames import Emergency, NmtCommand, NmtState, heartbeat_frame, nmt_frame, sync_frame
from canarm_protocol.faults.detection_events import DetectionEvent
from canarm_protocol.faults.fault_events import FaultEvent
from canarm_tui import DashboardApp
from canarm_tui.faults import Faults
from canarm_tui.history import COLUMNS, Column, History
from canarm_tui.notices import Kind, Notice
from canarm_tui.outcome import Outcome
from canarm_tui.player import Player
from canarm_tui.record import Record
from tests.tui.screens import MOST_LOOKS, screen_lines

S = 1_000_000_000
CYCLES = 8000
BEGIN, SEEN, END = 2000, 2040, 4000


@pytest.fixture
def record(cell):
    cycles = np.arange(CYCLES)
    values = np.full((CYCLES, 2, COLUMNS), np.nan, dtype=np.float32)
    values[:, :, Column.ANGLE] = (cycles / CYCLES)[:, np.newaxis]
    values[:, :, Column.REFERENCE], values[:, :, Column.ERROR] = 0.25, 0.5
    values[:, :, Column.COMMAND] = values[:, :, Column.CURRENT] = 0.75
    what = "set", "joint2.tachometer", "stuck"
    faults = Faults(
        events=(FaultEvent(10 * S, END, False, *what), FaultEvent(5 * S, BEGIN, True, *what)),
        detections=(DetectionEvent(SEEN, "tachometer-stuck", "joint2", "code 128", "substitute", 51 * S // 10),),
    )
    outcome = Outcome("FAILED: konkuk1", False, ["recorded in here"])
    return Record(cell, "here", History(cycles, values), faults, outcome, "mras", ("alpha", "", "", ""))


@pytest.fixture
def player(record):
    player = Player(record)
    player.receive([], 0)
    return player


def test_it_goes_on_with_the_wall_clock_at_its_speed_to_its_end(player):
    player.receive([], S)
    assert player.cycle == 400
    player.faster(1)
    player.receive([], 2 * S)
    assert player.cycle == 1200
    player.toggle()
    player.receive([], 10 * S)
    assert player.cycle == 1200
    player.toggle()
    player.receive([], 100 * S)
    assert (player.cycle, player.is_at_end) == (CYCLES - 1, True)
    player.toggle()
    assert (player.cycle, player.is_playing) == (0, True), "from its end it begins again"


def test_it_shows_what_a_live_run_would_have_shown_at_that_moment(player):
    player.seek(4000)
    snapshot = player.snapshot(0)
    assert snapshot.cycle == 4000
    assert snapshot.history.cycles.tolist() == list(range(4001))
    assert snapshot.cycles[0] == 0
    assert snapshot.joints[0].angle_rad == pytest.approx(0.5)
    assert (snapshot.joints[0].error_lsb, snapshot.joints[0].rms_lsb) == (0.5, 0.5)
    assert player.snapshot(1) is snapshot, "nothing is computed again while it stands"
    assert player.snapshot(0).replay == "▶ replay 10.00 of 20.00 s, 1 ×"


def test_it_seeks_from_event_to_event_both_ways_and_by_seconds(player):
    seen = []
    while player.next_event(is_back=False):
        seen.append(player.cycle)
    assert seen == [BEGIN, SEEN, END]
    assert player.next_event(is_back=True)
    assert player.cycle == SEEN
    player.skip(-1)
    assert player.cycle == SEEN - 2000
    assert not player.next_event(is_back=True)
    player.skip(-1)
    assert player.cycle == 0


def test_faults_and_detections_are_those_so_far(player):
    for cycle, acting, events, detections in ((0, 0, 0, 0), (BEGIN, 1, 1, 0), (SEEN, 1, 1, 1), (END, 0, 2, 1)):
        player.seek(cycle)
        faults = player.faults_now()
        assert (len(faults.acting), len(faults.events), len(faults.detections)) == (acting, events, detections)
        assert (player.faults.active, player.faults.begun) == (acting, min(events, 1))


def test_a_picture_that_came_before_the_faults_of_its_moment_is_not_kept(player):
    player.toggle()
    player.seek(BEGIN)
    early = player.snapshot(0)
    player.faults_now()
    assert (early.faults, player.snapshot(0).faults) == (None, player.faults)


async def test_the_dashboard_plays_it_in_its_views_and_asks_nobody(record, clock):
    app = DashboardApp(record.cell, lambda: pytest.fail("no bus"), clock_ns=clock, record=record)
    async with app.run_test(size=(120, 30)) as pilot:

        async def press(*keys, until=""):
            """The screen afterwards; words are not drawn anew in the very moment in which others were."""
            await pilot.press(*keys)
            for _ in range(MOST_LOOKS):
                clock.advance(0.2)
                app.drain()
                app.redraw()
                await pilot.pause()
                lines = screen_lines(app)
                if any(until in line for line in lines):
                    break
            return lines

        lines = await press("space", "n", until="▲ 1 fault acts")
        assert lines[0].strip().startswith("⏸ replay 5.00 of 20.00 s, 1 × │ konkuk1 │ mras │ here")
        assert any("▲ 1 fault acts" in line for line in lines)
        assert any("alpha" in line for line in lines)
        assert not any("FAILED" in line for line in lines)
        assert not any("Inject" in line or "Stop!" in line for line in lines), "keys that need a bench are gone"
        assert any("◆ detected: tachometer-stuck" in line for line in await press("n"))
        lines = await press("right_square_bracket", "full_stop")
        assert "⏸ replay 10.10 of 20.00 s, 2 ×" in lines[0]
        lines = await press("2")
        assert sum("joint2.tachometer stuck" in line and "│" in line for line in lines) >= 2
        await press("right_square_bracket", "right_square_bracket")
        lines = await press("1")
        assert any("✖ FAILED: konkuk1" in line for line in lines)
        lines = await press("left_square_bracket", "f", "e", "r", "w")
        assert not any("FAILED" in line for line in lines)
        assert len(app.screen_stack) == 1
        await pilot.press("q")
    assert app.return_code == 0


async def test_events_of_its_bus_and_of_its_controller_have_their_moments_wherever_the_record_is(record, clock):
    """Looked at in the middle of the record: what was before cycle 0 was before cycle 0."""
    frames = [heartbeat_frame(0x14, NmtState.BOOT_UP), nmt_frame(NmtCommand.START)]
    frames += [sync_frame(cycle % 240 + 1) for cycle in range(100)]
    stamped = [(0, each) for each in [*frames, Emergency(0x8130, 0x11).frame(0x14)]]
    noticed = (
        Notice(0, 20, Kind.CONTROLLER, "controller running"),
        Notice(0, 7999, Kind.CONTROLLER, "controller done"),
    )
    record = replace(record, frames=lambda: iter(stamped), noticed=noticed)
    app = DashboardApp(record.cell, lambda: pytest.fail("no bus"), clock_ns=clock, record=record)
    async with app.run_test(size=(120, 30)) as pilot:
        await pilot.press("space", "n", "n", "2")  # the controller's first state, then the fault
        app.drain()
        clock.advance(0.5)
        app.redraw()
        await pilot.pause()
        text = "\n".join(screen_lines(app))
        assert "before cycle 0 │ • adc has booted" in text
        assert "0.247 s (cycle 99) │ ! EMCY of adc: 0x8130 life guard or heartbeat error" in text
        assert "0.050 s (cycle 20) │ ▸ controller running" in text
        assert "controller done" not in text
