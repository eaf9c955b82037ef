"""The view of the wire, on figures and on a real bench without a wire model, which says so."""

import pytest

from canarm_protocol.faults.wire_figures import ErrorCounters, WireFigures
from canarm_tui import DashboardApp
from canarm_tui.texts import Tone
from canarm_tui.wire_view import WirePane, wire_lines
from tests.tui.screens import SIZES, at_every_size, screen_lines

FIGURES = WireFigures(
    load=0.214,
    total_load=0.19,
    worst_response_us=613.0,
    worst_cob_id=0x394,
    error_frames=12,
    lost_frames=0,
    cards={"dac": ErrorCounters(0, 3, 0), "latch": ErrorCounters(136, 0, 1), "adc": ErrorCounters(256, 0, 2)},
    dropped={"can0": 0, "bench": 7},
    clients={"can0": 2, "bench": 1},
)


def texts(figures):
    return ["".join(word.text for word in line) for line in wire_lines(figures)]


def test_figures_are_in_words_and_what_is_wrong_has_a_sign():
    lines = texts(FIGURES)
    assert lines[0] == "load 21.4 % of the last second, 19.0 % since start"
    assert lines[1] == "slowest frame 613 µs from offer to last bit, frame 0x394"
    assert lines[2] == "▲ error frames 12   lost frames 0"
    assert any(line.split() == ["dac", "0", "3", "●", "error-active"] for line in lines)
    assert any(line.split() == ["latch", "136", "0", "▲", "error-passive"] for line in lines)
    assert any(line.split() == ["adc", "256", "0", "✖", "bus-off"] for line in lines)
    assert any(line.split() == ["bench", "1", "▲", "7"] for line in lines)


def test_a_busy_wire_is_marked():
    busy = WireFigures(0.93, 0.9, 2000.0, 0x394, 0, 0, {}, {}, {})
    assert texts(busy)[0].startswith("▲ load 93.0 %")
    assert wire_lines(busy)[0][0].tone is Tone.WARNING


@pytest.fixture
def app(cell, loop, clock):
    return DashboardApp(cell, lambda: loop, clock_ns=clock, in_background=lambda job: job())


async def looked_at(app, loop, clock, pilot):
    await pilot.press("6")
    for _ in range(4):
        clock.advance(0.5)
        loop.telemetry()
        app.drain()
        app.redraw()
    await pilot.pause()


async def test_a_bench_without_a_wire_model_says_so_and_makes_up_no_error_counters(app, loop, clock):
    async with app.run_test(size=(120, 35)) as pilot:
        await looked_at(app, loop, clock, pilot)
        lines = screen_lines(app)
        assert any("no wire model runs: canarm emulator --wire" in line for line in lines)
        assert not any("TEC" in line or "error-active" in line for line in lines)


async def test_the_bench_is_asked_only_while_the_view_is_looked_at(app, loop, clock):
    async with app.run_test(size=(120, 35)) as pilot:
        for _ in range(4):
            clock.advance(2.0)
            loop.telemetry()
            app.drain()
            app.redraw()
        assert 0x2300 not in loop.requests
        await looked_at(app, loop, clock, pilot)
        assert loop.requests.count(0x2300) == 3, "at once, and after one and two of the two seconds"


async def test_a_bench_that_does_not_answer_is_named_and_asked_again_later(app, loop, clock, monkeypatch):
    monkeypatch.setattr("canarm_tui.fault_desk.LIMIT_S", 0.01)
    async with app.run_test(size=(120, 35)) as pilot:
        loop.telemetry()
        app.drain()
        loop.is_silent = True
        await pilot.press("6")
        for _ in range(3):
            app.drain()
            app.redraw()
        assert any("has not answered" in word.text for line in app.query_one(WirePane).lines for word in line)
        loop.is_silent = False
        clock.advance(6.0)
        await looked_at(app, loop, clock, pilot)
        assert any("no wire model runs" in word.text for line in app.query_one(WirePane).lines for word in line)


async def test_on_a_low_screen_the_cyclic_frames_are_scrolled_to(app, loop, clock):
    async with app.run_test(size=(80, 24)) as pilot:
        await looked_at(app, loop, clock, pilot)
        pane = app.query_one(WirePane)
        pane.lines = wire_lines(FIGURES)
        for _ in range(2):
            app.redraw()
            await pilot.pause()
        lines = screen_lines(app)[pane.region.y : pane.region.bottom]
        assert any("080 SYNC" in line for line in lines)
        assert lines[-1].strip(), "no line is left empty"
        await pilot.press("end")
        app.redraw()
        await pilot.pause()
        assert any("heartbeat of adc" in line and " % of " in line for line in screen_lines(app))


async def test_the_view_at_every_size(app, loop, clock):
    async with app.run_test(size=SIZES[0]) as pilot:
        await looked_at(app, loop, clock, pilot)
        app.query_one(WirePane).lines = wire_lines(FIGURES)
        await at_every_size(app, pilot, "wire", "#pane-wire")
