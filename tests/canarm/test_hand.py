"""The dashboard's hand on an emulator: the jog's master in a thread, and the dashboard in a terminal that drives it."""

import re
import shutil
import signal
import sys

import pytest

from canarm.jogging.after_run import port_after_run
from canarm.jogging.hand import HandInThread
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.transport.port import open_port
from canarm_tui.bus.hand import HandState
from tests.tui.test_dashboard_terminal import Terminal, wait_for


@pytest.fixture
def emulator(canarm):
    return canarm.emulator("sync")


@pytest.fixture
def hand(emulator):
    hand = HandInThread(load_cell("konkuk1"), lambda: open_port("canarm", "can0", port=emulator.port))
    yield hand
    hand.close()


def said(hand):
    return "\n".join(text for _, text in hand.lines)


def test_outputs_are_set_steps_are_made_and_the_cards_are_left_safe(hand, until):
    """0.3 A of 1.5 are code 51; a cycle later the sense shows it, as in examples/by_hand.md."""
    assert (hand.state, hand.codes) == (HandState.OFF, ())
    hand.take()
    until(lambda: hand.state is HandState.READY, "the cards are in hand")
    hand.do("current joint2 0.3; step 4; read")
    until(lambda: "joint2.current_sense" in said(hand), "inputs are read")
    assert hand.codes == (51, 0)
    assert hand.directions == ("ccw", "off")
    assert re.search(r"joint2\.current_sense +51 +0\.300 A", said(hand))
    hand.do("dac joint2 900")
    hand.do("fly")
    assert "CODE must be a whole number from 0 to 255" in said(hand)
    assert "no such command" in said(hand)
    hand.do("stop; sdo read dac 0x1000")
    until(lambda: "STOPPED and answer no SDO" in said(hand), "a refused command is said")
    assert hand.state is not HandState.OFF, "and ends nothing"
    hand.close()
    assert hand.state is HandState.OFF
    assert said(hand).endswith("the cards are not in hand")


def test_each_of_five_quick_steps_of_a_code_counts_from_the_one_before(hand, until):
    hand.take()
    until(lambda: hand.state is HandState.READY, "the cards are in hand")
    for _ in range(5):
        hand.do(f"dac joint2 {hand.codes[0] + 1}")
    assert hand.codes == (5, 0)
    hand.do("off; dac joint3 2; dir joint2 cw")
    assert (hand.codes, hand.directions) == ((0, 2), ("cw", "off"))
    until(lambda: hand.state is HandState.READY, "all is carried out")
    assert (hand.codes, hand.directions) == ((0, 2), ("cw", "off"))


def test_after_a_run_the_cards_are_driven_by_hand_and_its_record_has_ended(canarm, until, tmp_path):
    """Not before the end of the run; what is done by hand is not in can0.log."""
    emulator = canarm.emulator("sync", "--out", str(tmp_path / "run"))
    cell, over = load_cell("konkuk1"), []
    at_end = port_after_run(
        *(cell, lambda: bool(over)),
        *(lambda bus=bus: open_port("canarm", bus, port=emulator.port) for bus in ("can0", "bench")),
    )
    hand = HandInThread(cell, at_end)
    hand.take()
    until(lambda: hand.state is HandState.OFF and hand.lines, "the hand has given up")
    assert "the run goes on, and its controller has the cards" in said(hand)
    over.append(True)
    hand.take()
    until(lambda: hand.state is HandState.READY, "the cards are in hand")
    hand.do("step 4; read")
    until(lambda: "joint2.current_sense" in said(hand), "inputs are read")
    hand.close()
    emulator.send(signal.SIGINT)
    emulator.wait()
    assert not (tmp_path / "run" / "can0.log").read_text().count(" 080#"), "no SYNC of ours is recorded"


def test_where_a_controller_runs_nothing_is_taken(canarm, emulator, hand, until):
    controller = canarm.controller(emulator, "sync", "--pace", "1", "--seconds", "20")
    controller.wait_for("cycle")
    hand.take()
    until(lambda: hand.state is HandState.OFF and hand.lines, "the hand has given up")
    assert "another controller is on the bus; it has the cards" in said(hand)
    assert controller.is_running


def test_a_bus_that_is_not_there_is_said(until):
    hand = HandInThread(load_cell("konkuk1"), lambda: open_port("canarm", "can0", port=1))
    hand.take()
    until(lambda: hand.state is HandState.OFF and hand.lines, "the hand has given up")
    assert "nobody listens there" in said(hand)
    hand.close()


@pytest.mark.skipif(shutil.which("tmux") is None, reason="tmux is not installed")
def test_the_cards_of_a_real_emulator_are_driven_from_the_dashboard(emulator, tmp_path):
    command = [sys.executable, "-m", "canarm", "tui", "--connect", f"127.0.0.1:{emulator.port}"]
    terminal = Terminal(tmp_path / "tmux", 120, 48, command)
    try:
        wait_for(terminal, lambda: None, "● connected")
        terminal.press("5")
        wait_for(terminal, lambda: None, "joint2.current_command", "watched only")
        terminal.press("t")
        wait_for(terminal, lambda: None, "Take the cards in hand?")
        terminal.press("Enter")
        wait_for(terminal, lambda: None, "by hand, ready")
        terminal.press("j")
        wait_for(terminal, lambda: None, "commands of canarm jog")
        terminal.type("current joint2 0.4; step 3")
        wait_for(terminal, lambda: None, "current joint2 0.4; step 3")
        terminal.press("Enter")
        wait_for(terminal, lambda: None, "4.000 V 0.400 A", "$C0A0=4 $C0A1=4", "memory: sample 2 of 4096, cycle 2")
        terminal.press("3")
        wait_for(terminal, lambda: None, "RPDO2 of dac joint2.current_command 0.4000 A")
        terminal.press("q")
        assert wait_for(terminal, lambda: None, "exit status").strip() == "exit status 0"
    finally:
        terminal.close()
