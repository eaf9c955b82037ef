"""The dashboard as its user meets it, on a fake bus and a clock set by hand: keys, states, sizes."""

import contextlib
import math

import pytest

from canarm_protocol.errors import BusError
from canarm_tui import DashboardApp, TerminalError, run_dashboard
from canarm_tui.joints_table import JointsTable
from canarm_tui.outcome import Outcome, OutcomePanel
from canarm_tui.plot import LABEL_WIDTH
from canarm_tui.texts import Word
from canarm_tui.trace import Trace, signs_of
from canarm_tui.view_registry import VIEWS
from canarm_tui.widgets import WordLine

LSB_RAD = math.radians(270.0 / 255.0)
WIDE, NARROW = (120, 36), (90, 30)


@pytest.fixture
def app(cell, port, clock):
    return DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job())


@contextlib.asynccontextmanager
async def running(app, size=WIDE):
    async with app.run_test(size=size) as pilot:
        await shown(app, pilot)
        yield pilot


async def shown(app, pilot):
    """What the timers do sooner or later, now."""
    app.drain()
    app.redraw()
    await pilot.pause()


def line(app, name):
    return " │ ".join(word.text for word in app.screen_stack[0].query_one(f"#{name}", WordLine).words)


def row(app, index):
    return app.screen_stack[0].query_one(JointsTable).row(index)


def screen_text(app):
    """The characters of the screen, line by line."""
    return ["".join(segment.text for segment in strip) for strip in app.screen._compositor.render_strips()]


async def test_a_sample_is_shown_in_the_table_and_the_header(app, port, wire):
    async with running(app) as pilot:
        port.arriving = [*wire.report(8, 0, 2), *wire.reference(8, 0.5), *wire.telemetry(8, 0.5 + LSB_RAD / 2, 1.5)]
        await shown(app, pilot)
        assert line(app, "header").startswith("● connected │ ▶ running │ 0.0 s │ age 0.00 s │ late+missed 0")
        degrees = math.degrees(0.5)
        assert row(app, 0) == [
            "joint2", f"+{degrees:.2f}", f"+{degrees + 270 / 255 / 2:.2f}", "–", "+0.50", "0.50", "+0.500", "+0.250",
            "▲ 17 % +", "+1.500", "255", "+", "–",
        ]  # fmt: skip
        assert any("joint3 error +0.50 LSB" in text for text in screen_text(app))


async def test_a_connection_without_telemetry_says_so(app):
    async with running(app):
        assert line(app, "header").startswith("○ no data")
        assert line(app, "notice") == "-i fake -c bench: no telemetry yet; is this the bench bus of a running emulator?"


async def test_data_that_stop_are_called_stale_and_stay(app, port, wire, clock):
    async with running(app) as pilot:
        port.arriving = wire.telemetry(8, 0.5)
        await shown(app, pilot)
        before = row(app, 0)
        clock.advance(0.6)
        await shown(app, pilot)
        assert "▲ stale 0.6 s" in line(app, "header")
        assert row(app, 0) == before


async def test_a_lost_bus_is_named_the_data_stay_and_it_comes_back(cell, port, wire, clock):
    ports = [port, type(port)()]
    app = DashboardApp(cell, lambda: ports.pop(0), clock_ns=clock, in_background=lambda job: job())
    async with running(app) as pilot:
        port.arriving = wire.telemetry(8, 0.5)
        await shown(app, pilot)
        before, second = row(app, 0), ports[0]
        port.is_broken = True
        await shown(app, pilot)
        assert line(app, "header").startswith("✖ lost")
        assert line(app, "notice") == "-i fake -c bench: the server closed the connection; trying again every second"
        assert "the server closed" in screen_text(app)[1]
        assert row(app, 0) == before
        clock.advance(1.0)
        second.arriving = wire.telemetry(800, 0.25)
        await shown(app, pilot)
        assert line(app, "header").startswith("● connected")
        assert line(app, "notice") == ""
        assert "dropped samples 0" in line(app, "counters")


async def test_a_bus_that_cannot_be_opened_is_not_called_lost(cell, clock):
    def refuse():
        raise BusError("-i canarm -c bench: nobody listens there; start one with: canarm emulator")

    app = DashboardApp(cell, refuse, clock_ns=clock, in_background=lambda job: job())
    async with running(app) as pilot:
        assert line(app, "header").startswith("✖ not connected")
        assert "start one with: canarm emulator" in line(app, "notice")
        await pilot.press("q")
    assert app.return_code == 0


async def test_a_paused_dashboard_holds_its_panes_but_not_its_header(app, port, wire):
    async with running(app) as pilot:
        port.arriving = wire.telemetry(8, 0.5)
        await shown(app, pilot)
        before = row(app, 0)
        await pilot.press("space")
        port.arriving = wire.telemetry(12, 0.25) + wire.report(12, 0, 3)
        await shown(app, pilot)
        assert row(app, 0) == before
        assert "⏸ paused │ ▼ stopping" in line(app, "header")
        await pilot.press("space")
        await shown(app, pilot)
        assert row(app, 0)[2] == f"+{math.degrees(0.25):.2f}"
        assert "paused" not in line(app, "header")


async def test_help_opens_and_closes_and_q_quits_from_it(app):
    async with running(app) as pilot:
        await pilot.press("question_mark")
        assert any("dashboard" in text for text in screen_text(app))
        assert len(app.screen_stack) == 2
        await shown(app, pilot)
        await pilot.press("question_mark")
        assert len(app.screen_stack) == 1
        await pilot.press("question_mark", "q")
    assert app.return_code == 0


@pytest.mark.parametrize("before", [(), ("f",), ("question_mark",), ("R",)])
async def test_ctrl_c_leaves_the_dashboard_from_wherever_one_is(app, before):
    async with running(app) as pilot:
        await pilot.press(*before, "ctrl+c")
    assert app.return_code == 0
    assert not app.is_running


@pytest.mark.parametrize(
    "size", [(1, 1), *(pytest.param(each, marks=pytest.mark.slow) for each in ((1, 24), (80, 1), (5, 5)))]
)
async def test_a_terminal_of_one_column_or_line_is_borne(app, port, wire, size):
    async with running(app, size) as pilot:
        for key in (
            "question_mark",
            "escape",
            "f",
            "escape",
            "x",
            "escape",
            "R",
            "escape",
            "Q",
            "escape",
            "r",
            "space",
        ):
            port.arriving = [*wire.report(8, 0, 2), *wire.reference(8, 0.5), *wire.telemetry(8, 0.5)]
            await shown(app, pilot)
            await pilot.press(key)
        await pilot.resize_terminal(*WIDE)
        await shown(app, pilot)
        await pilot.resize_terminal(1, 1)
        await shown(app, pilot)
        await pilot.press("q")
    assert app.return_code == 0


async def test_while_nothing_comes_the_traces_are_not_drawn_again(app, port, wire, clock):
    """An idle bench that is watched costs next to nothing; its telemetry repeats the last cycle."""
    drawn = []
    async with running(app) as pilot:
        port.arriving = [*wire.report(8, 0, 2), *wire.reference(8, 0.5), *wire.telemetry(8, 0.5)]
        await shown(app, pilot)
        traces = [trace for trace in app.query(Trace) if trace.region]
        for trace in traces:
            trace.draw = lambda *size: drawn.append(size) or []
        for _ in range(5):
            clock.advance(0.1)
            port.arriving = wire.telemetry(8, 0.5)
            await shown(app, pilot)
        assert len(drawn) <= len(traces), "once, for the title: it has no error any more"
        port.arriving = [*wire.reference(12, 0.5), *wire.telemetry(12, 0.5)]
        await shown(app, pilot)
        assert len(drawn) > len(traces)


async def test_while_nothing_comes_the_screen_is_drawn_once_a_second_and_news_at_once(app, port, wire, clock):
    async with running(app):
        drawn, start_ns = [], clock.now_ns
        app.redraw_news()
        app.redraw = lambda: drawn.append(clock.now_ns)
        for tenth in range(1, 31):
            clock.advance(0.1)
            port.arriving = wire.telemetry(8, 0.5) if tenth > 3 else []
            app.drain()
            app.redraw_news()
        seconds = [round((each - start_ns) / 1e9, 1) for each in drawn]
        assert seconds == [0.4, 1.4, 2.4], "the first sample, and then once a second"
        for news in (wire.telemetry(12, 0.5), wire.report(12, 0, 3)):
            port.arriving = news
            app.drain()
            app.redraw_news()
        assert len(drawn) == 5


async def test_the_palette_offers_commands_by_area(app):
    commands = [command.title for command in app.get_system_commands(None)]
    assert commands == [
        "View: pause", *(f"View: {view.title.lower()}" for view in VIEWS), "View: theme", "View: picture",
        "Fault: inject", "Fault: clear",
        "Run: summary", "Bench: recording",
        "Bench: emergency stop", "Bench: reset", "Run: again", "Dashboard: help", "Dashboard: quit",
        "Dashboard: quit and stop",
    ]  # fmt: skip
    async with running(app) as pilot:
        await pilot.press("ctrl+p")
        await pilot.press("q")
        assert app.is_running, "a letter typed into the palette quit the dashboard"
        await pilot.press("escape", "q")
    assert app.return_code == 0


async def test_how_the_run_has_ended_is_shown_and_stays(cell, port, wire, clock):
    ended = []
    app = DashboardApp(
        cell,
        lambda: port,
        clock_ns=clock,
        in_background=lambda job: job(),
        outcome_of=lambda: ended[0] if ended else None,
    )
    async with running(app) as pilot:
        port.arriving = wire.telemetry(8, 0.5)
        await shown(app, pilot)
        assert not app.query_one(OutcomePanel).region
        ended.append(Outcome("FAILED: konkuk1", False, ("joint2: current-mismatch", "recorded in [red]run")))
        app.drain()
        app.redraw_news()
        await pilot.pause()
        lines = screen_text(app)
        assert any("✖ FAILED: konkuk1 │ q leaves" in text for text in lines)
        assert any("recorded in [red]run" in text for text in lines)
        clock.advance(3600.0)
        await shown(app, pilot)
        assert app.is_running
        assert any("joint2: current-mismatch" in text for text in screen_text(app))


async def test_on_a_low_terminal_the_outcome_leaves_room_for_the_views(cell, port, clock):
    outcome = Outcome("FAILED: konkuk1", False, ["joint2: stuck", "recorded in run", *map(str, range(20))])
    app = DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job(), outcome_of=lambda: outcome)
    async with running(app, (80, 24)) as pilot:
        assert app.query_one(OutcomePanel).region.height == 7
        assert any("recorded in run" in text for text in screen_text(app))
        assert any("h shows all" in text for text in screen_text(app))
        assert any(trace.region for trace in app.query(Trace))
        await pilot.press("h")
        assert any("17" in text for text in screen_text(app)), "all of it fits the dialog"
        await pilot.press("escape")
        await pilot.resize_terminal(120, 40)
        await shown(app, pilot)
        assert app.query_one(OutcomePanel).region.height > 10


async def test_the_caller_is_told_once_that_the_dashboard_stands(cell, port, clock):
    calls = []
    app = DashboardApp(
        cell,
        lambda: port,
        clock_ns=clock,
        in_background=lambda job: job(),
        on_start=lambda: calls.append(port.sent[0].can_id),
    )
    async with running(app) as pilot:
        await pilot.pause()
    assert calls == [0x731]
    assert port.is_closed


async def test_a_constant_error_is_drawn_where_the_scale_says(app, port, wire):
    # 2 s of an error of exactly +1 LSB: the line lies on the upper limit.
    async with running(app) as pilot:
        for cycle in range(0, 800, 4):
            port.arriving += wire.reference(cycle) + wire.telemetry(cycle, LSB_RAD)
        await shown(app, pilot)
        trace = app.query_one("#trace-joint2-0", Trace)
        lines = [trace.render_line(y) for y in range(trace.size.height)]
        marked = [strip.text for strip in lines if strip.text.startswith("    +1│")]
        assert len(marked) == 1
        cells = marked[0][LABEL_WIDTH:]
        seen = len(cells) // 6  # of 10 s
        assert set(cells[-seen:]) <= set("⠉⠒⠤⣀"), "one dot row, on every column"
        assert len(set(cells[-seen:])) == 1
        assert set(cells[: 3 * seen]) <= set("⠁⠂⠄⡀"), "before the run only the dotted limit"
        assert not any(set(strip.text[-seen:]) & set("⠉⠒⠤⣀") for strip in lines[1:] if strip.text != marked[0])


def test_events_are_marked_above_the_trace_where_they_happened():
    # 10 s, 4000 cycles up to cycle 4000, in 100 cells of 40 cycles.
    happened = [(3900, "◆"), (3900, "▲"), (2000, "○"), (9000, "×"), (-1, "×")]
    signs = signs_of([(cycle, Word(sign)) for cycle, sign in happened], 3999, 20, 100)
    assert {cell: word.text for cell, word in signs.items()} == {97: "▲", 98: "◆", 50: "○"}


def test_a_fault_and_its_detection_in_the_newest_column_are_both_seen():
    signs = signs_of([(3999, Word("◆")), (3999, Word("▲")), (3998, Word("○"))], 3999, 20, 100)
    assert {cell: word.text for cell, word in signs.items()} == {97: "○", 98: "▲", 99: "◆"}


def test_without_a_terminal_the_dashboard_says_what_to_do(cell, monkeypatch):
    monkeypatch.setattr("sys.__stdin__", None)
    with pytest.raises(TerminalError, match="is no terminal, and the dashboard needs one"):
        run_dashboard(cell, "canarm", "bench", {})
