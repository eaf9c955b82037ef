"""The view of frames as its user meets it, on a fake bus and a clock set by hand."""

import pytest
from textual.widgets import Input

from canarm_protocol.canopen.frames import ERROR_FLAG, Frame
from canarm_protocol.decoding import robot_book
from canarm_protocol.errors import BusError
from canarm_tui import DashboardApp
from canarm_tui.bus.frame_screen import FrameScreen
from canarm_tui.bus.frames_view import FramesPane
from canarm_tui.bus.monitor import MonitorApp
from canarm_tui.bus.watch import BusWatch
from canarm_tui.grid import Grid
from canarm_tui.texts import Tone
from tests.tui.bus.frames import at_once, cycles, filled, frame, shown
from tests.tui.screens import SIZES, at_every_size, screen_lines


def identifiers(app):
    return [row.frame.can_id for row in app.query_one("#frames", Grid).rows]


async def test_the_view_at_every_size(monitor, port, clock):
    async with monitor.run_test(size=SIZES[0]) as pilot:
        await filled(monitor, port, clock, pilot)
        await at_every_size(monitor, pilot, "frames")
        await pilot.press("home", "down", "down", "enter")
        await at_every_size(monitor, pilot, "frame")


async def test_rates_data_and_meanings_are_those_of_the_frames(monitor, port, clock):
    async with monitor.run_test(size=(120, 30)) as pilot:
        await filled(monitor, port, clock, pilot, 3.0)
        lines = screen_lines(monitor)
        line = next(each for each in lines if each.startswith(" 312 "))
        # 0x44 << 7 is code 68 of 255, 0.4 A of 1.5.
        assert line.split()[:8] == ["312", "1200", "400", "2.50", "00", "22", "00", "00"]
        assert "RPDO2 of dac  joint2.current_command 0.4000 A" in line
        assert any("heartbeat of adc  operational" in each for each in lines)
        # Five frames a cycle, and four heartbeats every eighth.
        assert any("2200 frames/s" in each for each in lines)


async def test_changed_bytes_are_marked_until_they_are_old(monitor, port, clock):
    async with monitor.run_test(size=(120, 30)) as pilot:
        port.arriving = [(0, frame("123#0000")), (1, frame("123#00FF"))]
        await shown(monitor, pilot)
        grid = monitor.query_one("#frames", Grid)

        def tones():
            return [word.tone for word in grid._cells(grid.rows[0])[4] if word.text.strip()]

        assert tones() == [Tone.PLAIN, Tone.CHANGED]
        clock.advance(1.1)
        await shown(monitor, pilot)
        assert tones() == [Tone.PLAIN, Tone.PLAIN]


async def test_a_filter_acts_while_it_is_typed_stays_and_goes(monitor, port, clock):
    async with monitor.run_test(size=(120, 30)) as pilot:
        await filled(monitor, port, clock, pilot, 0.1)
        everything = identifiers(monitor)
        await pilot.press("slash", "a", "d", "c")
        await shown(monitor, pilot)
        assert identifiers(monitor) == [0x294, 0x394, 0x714]
        await pilot.press("enter")
        assert monitor.focused.id == "frames"
        assert not monitor.query_one(Input).display
        assert any("filter: adc" in line for line in screen_lines(monitor))
        await pilot.press("escape")
        await shown(monitor, pilot)
        assert identifiers(monitor) == everything


async def test_where_there_is_nothing_the_view_says_why(monitor, port, clock):
    async with monitor.run_test(size=(120, 30)) as pilot:
        await shown(monitor, pilot)
        text = "\n".join(screen_lines(monitor))
        assert "no frame since this view was opened" in text
        assert "no frame was heard yet" in text
        await filled(monitor, port, clock, pilot, 0.1)
        await pilot.press("slash", *"nobody")
        await shown(monitor, pilot)
        text = "\n".join(screen_lines(monitor))
        assert "nothing fits the filter" in text
        assert "no frame" not in text


async def test_rows_are_put_in_order_and_the_cursor_stays_with_its_row(monitor, port, clock):
    async with monitor.run_test(size=(120, 30)) as pilot:
        await filled(monitor, port, clock, pilot, 2.0)
        grid = monitor.query_one("#frames", Grid)
        assert identifiers(monitor) == sorted(identifiers(monitor))
        await pilot.press("end")
        assert grid.chosen.frame.can_id == 0x714
        await pilot.press("o")
        await shown(monitor, pilot)
        assert grid.chosen.frame.can_id == 0x714
        rates = [row.rate_hz for row in grid.rows]
        assert rates == sorted(rates, reverse=True)
        port.arriving = [(9_000_000_000, frame("7FF#00"))]
        clock.advance(1.0)
        await pilot.press("o")
        await shown(monitor, pilot)
        assert identifiers(monitor)[0] == 0x7FF


async def test_a_frame_is_opened_down_to_its_bits_and_goes_on(monitor, port):
    async with monitor.run_test(size=(100, 30)) as pilot:
        port.arriving = [(0, frame("213#02"))]
        await shown(monitor, pilot)
        await pilot.press("enter")
        assert isinstance(monitor.screen, FrameScreen)
        port.arriving = [(1, frame("213#0A"))]
        monitor.drain()
        monitor.screen.redraw()
        await pilot.pause()
        lines = screen_lines(monitor)
        assert any("0   0A   0 0 0 0 1 0 1 0    ····bbaa" in line for line in lines), lines
        assert any("a  joint2.direction" in line and "counter-clockwise" in line for line in lines)
        await pilot.press("space")
        port.arriving = [(2, frame("213#00"))]
        monitor.drain()
        monitor.screen.redraw()
        await pilot.pause()
        assert any("0   0A" in line for line in screen_lines(monitor)), "it is held"
        await pilot.press("escape")
        assert not isinstance(monitor.screen, FrameScreen)


async def test_paused_the_screen_stands_still_and_frames_are_counted(monitor, port):
    async with monitor.run_test(size=(120, 30)) as pilot:
        port.arriving = [(0, frame("123#00"))]
        await shown(monitor, pilot)
        await pilot.press("space")
        port.arriving = [(1, frame("124#00"))]
        await shown(monitor, pilot)
        assert identifiers(monitor) == [0x123]
        assert any("⏸ paused" in line for line in screen_lines(monitor))
        await pilot.press("space")
        await shown(monitor, pilot)
        assert identifiers(monitor) == [0x123, 0x124]


async def test_the_log_follows_until_its_reader_leaves_the_end(monitor, port, clock):
    async with monitor.run_test(size=(160, 30)) as pilot:
        await filled(monitor, port, clock, pilot, 0.5)
        log = monitor.query_one("#frame-log", Grid)
        assert log.cursor == len(log.rows) - 1
        await pilot.press("tab")
        assert monitor.focused is log
        await pilot.press("pageup")
        kept = log.chosen
        port.arriving = cycles(400, 4)
        await shown(monitor, pilot)
        assert log.chosen is kept
        await pilot.press("end")
        port.arriving = cycles(404, 4)
        await shown(monitor, pilot)
        assert log.cursor == len(log.rows) - 1


async def test_a_frame_of_the_log_is_opened_as_it_was(monitor, port):
    async with monitor.run_test(size=(160, 30)) as pilot:
        port.arriving = [(0, frame("213#02")), (1, frame("213#01"))]
        await shown(monitor, pilot)
        await pilot.press("tab", "home", "enter")
        port.arriving = [(2, frame("213#00"))]
        monitor.drain()
        monitor.screen.redraw()
        await pilot.pause()
        assert any("a  joint2.direction" in line and "counter-clockwise" in line for line in screen_lines(monitor))


async def test_nothing_is_ever_sent(monitor, port, clock):
    async with monitor.run_test(size=(120, 30)) as pilot:
        await filled(monitor, port, clock, pilot, 2.0)
        for key in ("slash", "a", "enter", "o", "c", "enter", "escape", "space", "question_mark", "escape"):
            await pilot.press(key)
        clock.advance(10.0)
        await shown(monitor, pilot)
    assert port.sent == []
    assert port.is_closed


HOSTILE = [
    frame("123#"),
    frame("080#0102030405060708"),
    frame("000#FF"),
    frame("5FF#FFFFFFFFFFFFFFFF"),
    frame("7FF#FF"),
    frame("0FF#1B5B324A"),
    Frame(0x1FFFFFFF, bytes(8), True),
    Frame(0x123, bytes(8), False, True),
    Frame(ERROR_FLAG | 0x1FF, bytes(8), True),
    Frame(0x294, bytes(64)),
]


@pytest.mark.parametrize("size", [(1, 1), (80, 24)], ids="{0[0]}x{0[1]}".format)
async def test_malformed_frames_and_terminals_of_any_size_are_borne(monitor, port, size):
    async with monitor.run_test(size=size) as pilot:
        port.arriving = list(enumerate(HOSTILE))
        await shown(monitor, pilot)
        assert len(identifiers(monitor)) == len(HOSTILE)
        await pilot.press("enter")
        opened = monitor.screen
        for row in monitor.query_one("#frames", Grid).rows:
            opened._opened = row
            opened.redraw()
            await pilot.pause()


async def test_a_storm_of_sizes_is_borne(monitor, port, clock):
    async with monitor.run_test(size=(80, 24)) as pilot:
        await filled(monitor, port, clock, pilot, 0.2)
        for size in [(1, 1), (300, 2), (2, 100), (149, 13), (150, 14), (80, 24)]:
            await pilot.resize_terminal(*size)
            await shown(monitor, pilot)
        assert any("TPDO2 of adc" in line for line in screen_lines(monitor))


async def test_names_with_escapes_and_markup_are_shown_as_text(watch, port, clock):
    watch.book.names[0x14] = "\x1b[2J[red]adc[/red]\n"
    app = MonitorApp(watch, clock_ns=clock)
    async with app.run_test(size=(120, 30)) as pilot:
        port.arriving = [(0, frame("714#05"))]
        await shown(app, pilot)
        assert any(r"heartbeat of \x1b[2J[red]adc[/red]\n  operational" in line for line in screen_lines(app))
        await pilot.press("enter")
        await pilot.pause()
        assert any(r"\x1b[2J[red]adc" in line for line in screen_lines(app))


async def test_a_bus_at_full_load_with_every_identifier_is_drawn(unknown, port, clock):
    """2048 identifiers, 20 000 frames in a second."""
    app = MonitorApp(unknown, clock_ns=clock)
    async with app.run_test(size=(160, 48)) as pilot:
        for drain in range(50):
            clock.advance(0.02)
            port.arriving = [
                (number * 50_000, Frame(number % 2048, bytes([drain] * (number % 9))))
                for number in range(drain * 400, drain * 400 + 400)
            ]
            app.drain()
            if drain % 5 == 0:
                app.redraw()
        await shown(app, pilot)
        assert len(identifiers(app)) == 2048
        assert any("2048 identifiers" in line and "20000 frames" in line for line in screen_lines(app))


async def test_a_lost_bus_is_named_and_tried_again(watch, port, clock):
    app = MonitorApp(watch, clock_ns=clock)
    async with app.run_test(size=(120, 30)) as pilot:
        port.arriving = [(0, frame("123#00"))]
        await shown(app, pilot)
        port.is_broken = True
        await shown(app, pilot)
        assert any("the server closed the connection; trying again every second" in line for line in screen_lines(app))
        assert any("✖ lost" in line for line in screen_lines(app))
        assert identifiers(app) == [0x123], "what was heard stays"
        port.is_broken = False
        clock.advance(1.0)
        await shown(app, pilot)
        await shown(app, pilot)
        assert any("● connected" in line for line in screen_lines(app))


async def test_an_interface_that_is_missing_is_named(unknown, clock):
    def refuse():
        raise BusError("-i socketcan -c vcan0: no such network interface; as root: ip link add vcan0 type vcan")

    app = MonitorApp(BusWatch(unknown.book, refuse, "-i socketcan -c vcan0", None, at_once), clock_ns=clock)
    async with app.run_test(size=(120, 30)) as pilot:
        await shown(app, pilot)
        assert any("ip link add vcan0" in line for line in screen_lines(app))
        assert any("✖ not connected" in line for line in screen_lines(app))
        await pilot.press("q")
    assert app.return_code == 0


async def test_the_dashboard_opens_the_robots_bus_when_it_is_first_looked_at(cell, port, clock):
    opened = []
    bench = type(port)()
    watch = BusWatch(robot_book(cell), lambda: opened.append(1) or port, "-i fake", None, at_once)
    app = DashboardApp(cell, lambda: bench, clock_ns=clock, in_background=at_once, bus=watch)
    async with app.run_test(size=(120, 36)) as pilot:
        await shown(app, pilot)
        assert opened == []
        await pilot.press("3")
        port.arriving = [(0, frame("714#05"))]
        await shown(app, pilot)
        assert opened == [1]
        assert app.query_one(FramesPane).region
        assert any("heartbeat of adc" in line for line in screen_lines(app))
    assert port.sent == []
    assert port.is_closed


async def test_without_a_named_bus_the_dashboard_says_what_to_give(cell, port, clock):
    app = DashboardApp(cell, lambda: port, clock_ns=clock, in_background=at_once)
    async with app.run_test(size=(120, 36)) as pilot:
        await pilot.press("3")
        await shown(app, pilot)
        assert any("start the dashboard with -i and -c of it" in line for line in screen_lines(app))
