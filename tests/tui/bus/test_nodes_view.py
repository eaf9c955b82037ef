"""The view of nodes and the objects of a node: on a fake bus, and on the bus of real cards, which answer by SDO."""

import pytest
from textual.widgets import Input

from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame
from canarm_protocol.decoding import Book, robot_book
from canarm_tui.bus.monitor import MonitorApp
from canarm_tui.bus.sdo_screen import SdoScreen
from canarm_tui.bus.watch import BusWatch
from canarm_tui.grid import Grid
from tests.tui.bus.frames import at_once, filled, frame, shown
from tests.tui.screens import SIZES, at_every_size, screen_lines

EMERGENCY = frame("094#3081110000000000")


def line_of(app, text):
    return next((line for line in screen_lines(app) if text in line), "")


async def test_the_view_at_every_size(monitor, port, clock):
    async with monitor.run_test(size=SIZES[0]) as pilot:
        await pilot.press("2")
        await filled(monitor, port, clock, pilot)
        port.arriving = [(2_000_000_000, frame("713#00")), (2_000_000_000, EMERGENCY)]
        await shown(monitor, pilot)
        clock.advance(2.5)
        await at_every_size(monitor, pilot, "nodes")


async def test_a_node_that_falls_silent_is_marked(monitor, port, clock):
    async with monitor.run_test(size=(120, 30)) as pilot:
        await pilot.press("2")
        await filled(monitor, port, clock, pilot, 1.0)
        assert "●" in line_of(monitor, "0x12 ")
        assert "▲" not in line_of(monitor, "0x12 ")
        for _ in range(12):
            clock.advance(0.1)
            port.arriving = [(0, frame("714#05"))]
            monitor.drain()
        await shown(monitor, pilot)
        assert "▲ 1.2 s" in line_of(monitor, "0x12 ")
        assert "▲" not in line_of(monitor, "0x14 ")


async def test_states_errors_and_hostile_names_are_in_words(watch, port, clock):
    watch.book.names[0x14] = "\x1b]0;x\x07[b]"
    app = MonitorApp(watch, clock_ns=clock)
    async with app.run_test(size=(160, 30)) as pilot:
        await pilot.press("2")
        texts = ["712#04", "713#7F", "714#33", "711#05"]
        port.arriving = [(0, frame(text)) for text in texts] + [(0, EMERGENCY)]
        await shown(app, pilot)
        assert "■ stopped" in line_of(app, "0x12 ")
        assert "○ pre-operational" in line_of(app, "0x13 ")
        assert "▲ state 0x33" in line_of(app, "0x14 ")
        assert r"\x1b]0;x\x07" in line_of(app, "0x14 ")
        assert "0x11 ▲ 0x8130 life guard or heartbeat error" in line_of(app, "0x14 ")


async def test_after_nmt_stop_and_pre_operational_no_card_is_called_operational(monitor, port, clock):
    """The end of a run: the cards are told, and no heartbeat comes any more."""
    async with monitor.run_test(size=(120, 35)) as pilot:
        await pilot.press("2")
        await filled(monitor, port, clock, pilot, 1.0)
        port.arriving = [(0, nmt_frame(NmtCommand.STOP))]
        await shown(monitor, pilot)
        for node in ("0x12", "0x13", "0x14"):
            assert "» stopped" in line_of(monitor, f"{node} ")
        assert "● operational" in line_of(monitor, "0x01 "), "the controller commands, and obeys nobody"
        port.arriving = [(0, nmt_frame(NmtCommand.PRE_OPERATIONAL, 0x12))]
        clock.advance(3.0)
        await shown(monitor, pilot)
        assert "» pre-operational" in line_of(monitor, "0x12 ")
        assert "was operational" in line_of(monitor, "0x01 ")
        port.arriving = [(0, frame("712#05"))]
        await shown(monitor, pilot)
        assert "● operational" in line_of(monitor, "0x12 ")


async def test_a_large_screen_has_the_frames_of_the_chosen_node(monitor, port, clock):
    async with monitor.run_test(size=(160, 48)) as pilot:
        await pilot.press("2")
        await filled(monitor, port, clock, pilot, 1.0)
        await pilot.press("end")
        await shown(monitor, pilot)
        shown_ids = [row.frame.can_id for row in monitor.query_one("#node-frames", Grid).rows]
        assert shown_ids == [0x294, 0x394, 0x714]
        assert "400" in line_of(monitor, "294 ")
        await pilot.press("home")
        await shown(monitor, pilot)
        assert line_of(monitor, "394 ") == ""
        for size in ((80, 24), (80, 12), (10, 3)):
            await pilot.resize_terminal(*size)
            await shown(monitor, pilot)


async def test_127_nodes_are_listed_and_scrolled(unknown, port, clock):
    app = MonitorApp(unknown, clock_ns=clock)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("2")
        port.arriving = [(0, Frame(0x700 + node_id, b"\x05")) for node_id in range(1, 128)]
        await shown(app, pilot)
        assert "127 nodes" in line_of(app, "nodes")
        await pilot.press("end")
        assert "node 0x7F" in line_of(app, "0x7F")


@pytest.fixture
def objects(cards, cell, clock):
    watch = BusWatch(robot_book(cell), lambda: cards, "-i loop -c can0", cell.bus.bitrate, at_once)
    return MonitorApp(watch, clock_ns=clock)


async def opened(app, pilot, node_id=0x14):
    """The screen of the objects of a node that has sent its boot-up message."""
    await pilot.press("2")
    await shown(app, pilot)
    nodes = app.query_one("#nodes", Grid)
    nodes.action_go([node.node_id for node in nodes.rows].index(node_id))
    await pilot.press("enter")
    assert isinstance(app.screen, SdoScreen)


async def answered(app, pilot):
    """All requests are answered."""
    for _ in range(2 * app.bus.desk.waiting + 2):
        app.drain()
    await pilot.pause()


async def typed(app, pilot, key, text):
    await pilot.press(key)
    app.screen.query_one(f"#{'sdo-find' if key == 'slash' else 'sdo-value'}", Input).value = text
    await pilot.pause()
    await pilot.press("enter")


def said(app):
    return " ".join(word.text for word in app.screen.said)


async def test_nothing_is_sent_until_a_key_asks_for_it(objects, cards, clock):
    async with objects.run_test(size=(120, 35)) as pilot:
        await opened(objects, pilot)
        await pilot.press("down", "down", "slash", "a", "escape", "up", "end", "home")
        clock.advance(10.0)
        await answered(objects, pilot)
        assert cards.sent == []


async def test_an_object_is_read_with_its_type_and_name(objects, cards):
    async with objects.run_test(size=(120, 35)) as pilot:
        await opened(objects, pilot)
        await typed(objects, pilot, "slash", "1008")
        await pilot.press("enter")
        await answered(objects, pilot)
        assert said(objects) == "1008:00 Manufacturer device name = ADC0809 card"
        assert "visible_string" in line_of(objects, "1008:00")
        assert "ADC0809 card" in line_of(objects, "1008:00")
        assert {each.can_id for each in cards.sent} == {0x614}


async def test_an_object_is_written_within_its_limits_and_read_back(objects, cards):
    """0x1029:01 of the cards is 0 to 2, by their data sheet; 0x1017 is a time in ms of 16 bits."""
    async with objects.run_test(size=(120, 35)) as pilot:
        await opened(objects, pilot)
        await typed(objects, pilot, "slash", "1017")
        await typed(objects, pilot, "w", "70000")
        assert "must be a whole number from 0 to 65535" in said(objects)
        assert cards.sent == []
        await typed(objects, pilot, "w", "250")
        await answered(objects, pilot)
        assert said(objects) == "1017:00 Producer heartbeat time = 250 (0x00FA)"


async def test_what_the_node_refuses_is_said_in_words(objects, cards):
    """0x1003 has no errors to be read: abort 0x08000024, no data available (CiA 301, table 22)."""
    async with objects.run_test(size=(120, 35)) as pilot:
        await opened(objects, pilot)
        await typed(objects, pilot, "slash", "1003:01")
        await pilot.press("enter")
        await answered(objects, pilot)
        assert said(objects).endswith(": no data available (0x08000024)")
        assert "✖" in line_of(objects, "1003:01")


async def test_read_only_and_write_only_objects_are_told_by_the_data_sheet(objects, cards):
    async with objects.run_test(size=(120, 35)) as pilot:
        await opened(objects, pilot)
        await typed(objects, pilot, "slash", "1000:00")
        await pilot.press("w")
        assert said(objects) == "1000:00 Device type: read only, by its data sheet"
        assert cards.sent == []


async def test_a_node_that_does_not_answer_is_named_and_the_screen_goes_on(objects, cards, monkeypatch):
    monkeypatch.setattr("canarm_tui.bus.sdo_desk.LIMIT_S", 0.01)
    async with objects.run_test(size=(120, 35)) as pilot:
        await opened(objects, pilot)
        cards.is_silent = True
        await pilot.press("enter")
        await answered(objects, pilot)
        assert said(objects).startswith("1000:00 Device type: no SDO answer (0x594) within 0.01 s")
        await pilot.press("escape")
        assert not isinstance(objects.screen, SdoScreen)


async def test_a_node_that_another_client_talks_to_is_left_alone(objects, cards, clock):
    async with objects.run_test(size=(120, 35)) as pilot:
        await opened(objects, pilot)
        cards.bench.receive(frame("614#4000100000000000"), "another")
        objects.drain()
        await pilot.press("enter")
        await answered(objects, pilot)
        assert "another client talks to this node just now; try again" in said(objects)
        assert cards.sent == []
        clock.advance(1.0)
        await pilot.press("enter")
        await answered(objects, pilot)
        assert "Device type = 262545 (0x00040191)" in said(objects)


async def test_all_that_is_shown_is_read_with_one_key(objects, cards):
    async with objects.run_test(size=(120, 35)) as pilot:
        await opened(objects, pilot)
        await typed(objects, pilot, "slash", "1018")
        await pilot.press("a")
        await answered(objects, pilot)
        values = [
            objects.screen._values[entry.index, entry.subindex].text for entry in objects.screen.query_one(Grid).rows
        ]
        assert values[0] == "4 (0x04)"
        assert len(values) == 5
        assert all(values)


async def test_the_identity_of_a_node_is_asked_for_and_then_known(objects, cards):
    """The product code in the card's data sheet is 0x0809; what was heard is not marked as the data sheet's."""
    async with objects.run_test(size=(160, 35)) as pilot:
        await pilot.press("2")
        await shown(objects, pilot)
        assert "0:809 EDS" in line_of(objects, "0x14 ")
        await pilot.press("end", "i")
        await answered(objects, pilot)
        await shown(objects, pilot)
        assert "0:809" in line_of(objects, "0x14 ")
        assert "EDS" not in line_of(objects, "0x14 ")


async def test_without_a_data_sheet_there_is_what_every_device_has(cards, clock):
    app = MonitorApp(BusWatch(Book(), lambda: cards, "-i loop", None, at_once), clock_ns=clock)
    async with app.run_test(size=(80, 24)) as pilot:
        await opened(app, pilot, 0x12)
        assert "without a data sheet (--eds)" in said(app)
        await pilot.press("enter")
        await answered(app, pilot)
        assert said(app) == "1000:00 Device type = 524689 (0x00080191)"


async def test_the_objects_at_every_size(objects):
    async with objects.run_test(size=SIZES[0]) as pilot:
        await opened(objects, pilot)
        await pilot.press("enter")
        await answered(objects, pilot)
        await at_every_size(objects, pilot, "objects")


async def test_a_started_card_is_read_as_well(objects, cards):
    async with objects.run_test(size=(120, 35)) as pilot:
        await opened(objects, pilot)
        cards.bench.receive(nmt_frame(NmtCommand.START), "another")
        await pilot.press("enter")
        await answered(objects, pilot)
        assert "Device type = 262545" in said(objects)
