"""What fills a large screen of the wire: numbers of the analysis (Davis et al. 2007), and past loads."""

import pytest

from canarm_protocol.cell.schedulability import Message, response_times
from canarm_tui import wire_room
from canarm_tui.wire_room import fitted, load_lines, traffic_lines
from canarm_tui.wire_view import WirePane, wire_lines
from tests.tui.screens import screen_lines
from tests.tui.test_wire_view import FIGURES, app, looked_at  # noqa: F401  # app is a fixture


def plain(lines):
    return ["".join(word.text for word in line) for line in lines]


def test_every_cyclic_frame_of_the_cell_has_its_worst_response_within_its_limit(cell):
    lines = plain(traffic_lines(cell))
    identifiers = [line.split()[0] for line in lines[2:]]
    assert identifiers == sorted(identifiers), "by priority"
    assert {"080", "294", "394", "213", "312", "701", "712", "713", "714"} <= set(identifiers)
    # SYNC with a counter: 34 control bits, 8 of data, (34 + 8 - 1) // 4 stuff bits, 13 behind them (Davis, eq. 1).
    assert "080 SYNC" in lines[2]
    assert lines[2].split()[2] == str(34 + 8 + 13 + 41 // 4)


def test_a_frame_that_comes_too_late_is_marked(cell, monkeypatch):
    """The paper's example (table 2): three frames of 1 ms, every 2.5, 3.5 and 3.5 ms; C answers within 3.5 ms."""
    messages = [Message(name, at, 125, period) for name, at, period in (("A", 1, 2_500_000), ("B", 2, 3_500_000))]
    messages.append(Message("C", 3, 125, 3_500_000, deadline_ns=3_250_000))
    assert response_times(messages, 125_000)[2].worst_ns == 3_500_000
    monkeypatch.setattr(wire_room, "cell_messages", lambda cell: messages)
    slow = cell.model_copy(update={"bus": cell.bus.model_copy(update={"bitrate": 125_000})})
    lines = plain(traffic_lines(slow))
    assert lines[2].split()[-3:] == ["%", "of", "2.50"]
    assert lines[4].endswith("▲      3.500  beyond 3.25")


@pytest.mark.parametrize(
    ("loads", "drawn"),
    [([0.05, 0.1], ["load of each second that this was looked at, up to 10 %", " █", "██"]),
     ([0.0, 0.15, 0.2], ["load of each second that this was looked at, up to 20 %", " ▄█", " ██"])],
)  # fmt: skip
def test_loads_are_drawn_against_the_next_full_tenth(loads, drawn):
    assert plain(load_lines(loads, 40, 2)) == drawn


def test_what_does_not_fit_as_a_whole_is_left_out():
    assert plain(fitted([[]], [[[], []], [[]]], 4)) == [""] * 4
    assert plain(fitted([[]], [[[], []], [[]]], 3)) == [""] * 3


async def test_a_large_screen_of_the_wire_is_mostly_filled(app, loop, clock):  # noqa: F811
    async with app.run_test(size=(160, 48)) as pilot:
        await looked_at(app, loop, clock, pilot)
        pane = app.query_one(WirePane)
        pane.lines = wire_lines(FIGURES)
        pane._loads.extend([0.1, 0.2] * 60)
        app.redraw()
        await pilot.pause()
        lines = screen_lines(app)[pane.region.y : pane.region.bottom]
        assert sum(bool(line.strip()) for line in lines) > 0.75 * len(lines)
