"""The views of the bus on a recorded run: as far as it has been played, back as well, and nothing can be sent."""

import numpy as np
import pytest

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.decoding import robot_book
from canarm_tui import DashboardApp
from canarm_tui.bus import recorded_watch
from canarm_tui.bus.recorded_watch import MOST_AT_ONCE, RecordedWatch
from canarm_tui.bus.sdo_screen import SdoScreen
from canarm_tui.history import COLUMNS, History
from canarm_tui.record import Record
from tests.tui.bus.frames import at_once, cycles, shown
from tests.tui.screens import screen_lines

CYCLES = 800


def recorded():
    """Before cycle 0, an answer to SDO; then the start, and the cycles."""
    yield 0, Frame(0x594, bytes.fromhex("4300100091010400"))
    yield 0, Frame(0x000, b"\x01\x00")
    yield from cycles(0, CYCLES)


class Place:
    """Where the record is."""

    def __init__(self):
        self.cycle = 0

    def __call__(self):
        return self.cycle


@pytest.fixture
def place():
    return Place()


@pytest.fixture
def watch(cell, place):
    return RecordedWatch(robot_book(cell), recorded, place, "runs/a", cell.bus.bitrate)


def times(watch, can_id):
    row = watch.store.row((can_id, False, False))
    return 0 if row is None else row.times


def test_frames_come_as_far_as_the_record_has_been_played(watch, place):
    watch.poll(0)
    assert times(watch, 0x080) == 0, "nobody looks yet"
    watch.wake()
    for place.cycle in (0, 1, 1, 99):
        watch.poll(0)
        assert times(watch, 0x080) == times(watch, 0x294) == place.cycle + 1
    assert times(watch, 0x594) == 1, "what came before cycle 0 is there as well"


def test_going_back_begins_anew(watch, place):
    watch.wake()
    for place.cycle in (200, 50, 60):
        watch.poll(0)
        assert times(watch, 0x080) == place.cycle + 1
    place.cycle = 10 * CYCLES
    watch.poll(0)
    watch.poll(0)
    assert times(watch, 0x080) == CYCLES, "at the end it stays"


def test_a_jump_far_ahead_is_made_in_parts(cell, place):
    watch = RecordedWatch(robot_book(cell), lambda: iter(cycles(0, 3000)), place, "runs/a", None)
    watch.wake()
    place.cycle = 2999
    watch.poll(0)
    assert watch.store.now(0).received == MOST_AT_ONCE
    assert watch.is_behind
    before = watch.changes
    for _ in range(4):
        watch.poll(0)
    assert times(watch, 0x080) == 3000
    assert not watch.is_behind
    assert watch.changes != before


@pytest.fixture
def app(cell, clock):
    rows = np.zeros((CYCLES, len(cell.joints), COLUMNS), dtype=np.float32)
    record = Record(cell, "runs/a", History(np.arange(CYCLES), rows), frames=recorded, memory=bytes(range(256)) * 96)
    return DashboardApp(cell, lambda: None, clock_ns=clock, in_background=at_once, record=record)


async def test_the_views_of_a_recorded_run_follow_it_and_nothing_is_sent(app, clock):
    async with app.run_test(size=(120, 45)) as pilot:
        await pilot.press("3")
        clock.advance(1.0)
        await shown(app, pilot)
        await shown(app, pilot)
        lines = screen_lines(app)
        assert any("▶ recorded" in line and "identifiers" in line for line in lines)
        assert any(line.split()[:2] == ["294", "401"] for line in lines), "a second after its beginning, cycle 400"
        await pilot.press("4", "enter")
        assert isinstance(app.screen, SdoScreen)
        await pilot.press("enter")
        await shown(app, pilot)
        await shown(app, pilot)
        assert any("a recorded run has no bus" in word.text for word in app.screen.said)


async def test_frames_before_where_a_record_stands_are_there_at_once_or_said_to_be_read(app, clock, monkeypatch):
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("space")
        app.player.seek(400)
        monkeypatch.setattr(recorded_watch, "MOST_AT_ONCE", 0)
        await pilot.press("3")
        for view in "345":
            await pilot.press(view)
            await shown(app, pilot)
            assert any("… reading the log" in line for line in screen_lines(app)), view
        app.action_pane("bus")
        await shown(app, pilot)
        assert any("the log is being read" in line for line in screen_lines(app))
        assert not any("no frame" in line for line in screen_lines(app))
        monkeypatch.undo()
        app.action_pane("bus")
        await pilot.pause()
        lines = screen_lines(app)
        assert any("▶ recorded" in line for line in lines)
        assert any(line.split()[:1] == ["294"] for line in lines)


async def test_a_record_without_frames_says_so_and_names_no_options_of_a_bus(cell, clock):
    rows = np.zeros((CYCLES, len(cell.joints), COLUMNS), dtype=np.float32)
    record = Record(cell, "runs/a", History(np.arange(CYCLES), rows))
    app = DashboardApp(cell, lambda: None, clock_ns=clock, in_background=at_once, record=record)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3")
        await shown(app, pilot)
        text = "\n".join(screen_lines(app))
        assert "no frame was recorded up to here" in text
        assert "not connected" not in text


async def test_the_memory_of_a_recorded_run_has_its_torque_table_and_keys_are_the_records(app, clock):
    async with app.run_test(size=(120, 45)) as pilot:
        await pilot.press("5")
        clock.advance(1.0)
        await shown(app, pilot)
        await shown(app, pilot)
        lines = screen_lines(app)
        place = next(number for number, line in enumerate(lines) if line.startswith(" $2000 torque joint2"))
        # Cycle 400 is sample $190; the image counts 0 to 255 over and over.
        assert any(line.startswith("   $2180: 80 81 82") and " 90 " in line for line in lines[place:])
        await pilot.press("left_square_bracket")
        assert app.player.cycle == 0, "[ goes back in the record"
