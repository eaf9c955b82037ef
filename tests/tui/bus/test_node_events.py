"""Events of nodes: what a recorded run's own bus tells, counted in cycles, and what is said of malformed frames."""

from canarm import Rig
from canarm_protocol.canopen.frames import (
    Emergency,
    Frame,
    NmtCommand,
    NmtState,
    heartbeat_frame,
    nmt_frame,
    sync_frame,
)
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.decoding import robot_book
from canarm_protocol.runs.can_log import log_frames
from canarm_tui.bus.node_events import NodeEvents
from canarm_tui.notices import Kind

CELL = load_cell("konkuk1")
ADC, DAC = 0x14, 0x12


def listening(near=None):
    return NodeEvents(robot_book(CELL), lambda: near)


def take(events, *frames):
    events.receive([(0, frame) for frame in frames])


def said(events):
    return [(each.cycle, each.what) for each in events.notices.kept]


def syncs(first, last):
    return [sync_frame(cycle % 240 + 1) for cycle in range(first, last + 1)]


def test_emcy_of_a_run_has_its_cycle_and_its_meaning(tmp_path):
    """A card that loses the controller's heartbeat says 0x8130 (CiA 301, table 26)."""
    with Rig("konkuk1", law="pd", out=tmp_path / "run") as rig:
        rig.inject("node.0x14", "hang", at=0.5)
        rig.run(1.0)
    events = listening()
    events.receive(list(log_frames(tmp_path / "run" / "can0.log")))
    kinds = [each.kind for each in events.notices.kept]
    assert Kind.NMT in kinds
    assert Kind.NODE in kinds
    assert not any(each.is_earlier for each in events.notices.kept)
    before = [each for each in events.notices.kept if each.cycle < 0]
    assert any("start to adc" in each.what or "start to all" in each.what for each in before)


def test_a_cycle_is_counted_from_nmt_start_on():
    events = listening()
    take(events, nmt_frame(NmtCommand.START, ADC), nmt_frame(NmtCommand.START, DAC), *syncs(0, 41))
    take(events, Emergency(0x8130, 0x11).frame(ADC))
    assert said(events)[-1] == (
        41,
        "EMCY of adc: 0x8130 life guard or heartbeat error, error register 0x11 (generic, communication)",
    )


def test_who_comes_late_takes_the_cycle_from_telemetry_and_sync():
    events = listening(near=1000)
    take(events, *syncs(1001, 1003), heartbeat_frame(ADC, NmtState.OPERATIONAL))
    take(events, heartbeat_frame(ADC, NmtState.PRE_OPERATIONAL))
    assert said(events) == [(1003, "adc is pre-operational")]


def test_the_next_nmt_start_begins_another_run():
    events = listening()
    take(events, nmt_frame(NmtCommand.START), *syncs(0, 3), nmt_frame(NmtCommand.START))
    assert [each.is_earlier for each in events.notices.kept] == [True, False]


def test_what_brings_the_next_run_up_is_before_its_cycle_0():
    """As a controller ends a run, stopped and pre-operational, and begins the next one, with a reset."""
    events = listening(near=0)
    start, reset = nmt_frame(NmtCommand.START, ADC), nmt_frame(NmtCommand.RESET_NODE, ADC)
    boot = heartbeat_frame(ADC, NmtState.BOOT_UP)
    take(events, boot, start, *syncs(0, 3), nmt_frame(NmtCommand.STOP, ADC), reset, boot, start, *syncs(0, 1), reset)
    known = [(each.is_earlier, each.cycle, each.what) for each in events.notices.kept]
    assert known == [
        (True, -1, "adc has booted"),
        (True, -1, "NMT: start to adc"),
        (True, 3, "NMT: stop to adc"),
        (False, -1, "NMT: reset-node to adc"),
        (False, -1, "adc has booted"),
        (False, -1, "NMT: start to adc"),
        (False, 1, "NMT: reset-node to adc"),
    ]


def test_the_same_again_is_counted():
    events = listening()
    take(events, *(Emergency(0x1000, 1).frame(ADC) for _ in range(50)))
    assert [each.times for each in events.notices.kept] == [50]


def test_malformed_frames_and_unknown_states_are_said_and_bounded():
    events = listening()
    take(events, Frame(0x000, b"\x07"), Frame(0x094, b"\x00"), Frame(0x714, b"\x05"), Frame(0x714, b"\x33"))
    what = " ".join(text for _, text in said(events))
    assert "malformed: 1 bytes instead of 2" in what
    assert "malformed: 1 bytes instead of 8" in what
    assert "adc is in the unknown state 51" in what
    for number in range(2000):
        take(events, Emergency(number, 1).frame(ADC))
    assert len(events.notices.kept) == 500
