"""Faults and lockstep: silence stalls nothing, runs are repeatable, and times count from each run's own start.

TIME (0x100) after every SYNC is what a controller in lockstep waits for.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from canarm import Rig
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame
from canarm_protocol.clock import Clock

CARDS = ("node.0x12", "node.0x13", "node.0x14")
SILENCES = {
    **{f"{fault} of all cards": [(card, fault, {}) for card in CARDS]
       for fault in ("crash", "hang", "reset", "line-broken", "late-boot")},
    **{f"{fault} of one card": [("node.0x14", fault, {})] for fault in ("crash", "hang", "reset", "line-broken")},
    "no card sees a SYNC": [(card, "sync-missed", {}) for card in CARDS],
    "wrong NMT states": [(card, "wrong-nmt-state", {"state": "stopped"}) for card in CARDS],
    "duplicates of all cards": [(card, "duplicate-node-id", {}) for card in CARDS],
    "clocks that drift": [(card, "clock-drift", {}) for card in CARDS],
    "every frame of the cards lost": [("can0.tx", "lost", {})],
    "every frame to the cards lost": [("can0.rx", "lost", {})],
    "all frames a second late": [("can0.tx", "delayed", {"delay": 1000}), ("can0.rx", "delayed", {"delay": 1000})],
    "all frames 21 times": [("can0.tx", "repeated", {"copies": 20})],
    "a late SYNC": [("bench.clock", "late-sync", {"delay": 500})],
    "a slow clock": [("bench.clock", "clock-drift", {"rate": 300})],
}  # fmt: skip
ON_THE_WIRE = {
    "a babbling idiot": [("can0.rx", "babbling-idiot", {"rate": 100_000, "length": 8})],
    "two babbling idiots": [(tap, "babbling-idiot", {"rate": 100_000}) for tap in ("can0.rx", "can0.tx")],
    "errors": [("can0.wire", "error-frames", {"count": 15})],
    "bus-off": [("can0.wire", "bus-off", {})],
    "no acknowledgement": [("can0.wire", "no-ack", {"count": 15})],
}  # fmt: skip
TYPICAL = ("hang of one card", "every frame of the cards lost", "a late SYNC", "errors", "bus-off")

Drive = Callable[..., Any]
FaultText = Callable[..., str]


def script(fault_text: FaultText, faults: list[tuple[str, str, dict[str, Any]]], **timing: float | None) -> str:
    return "parallel = true\n" + "".join(fault_text(tap, name, **timing, **more) for tap, name, more in faults)


@contextmanager
def limited(seconds: float) -> Iterator[threading.Event]:
    """Tells a loop that goes on for ever, so that the test fails instead of hanging."""
    is_over = threading.Event()
    timer = threading.Timer(seconds, is_over.set)
    timer.start()
    try:
        yield is_over
    finally:
        timer.cancel()


@pytest.mark.parametrize("with_wire", [False, True], ids=["", "wire"])
@pytest.mark.parametrize("name", SILENCES | ON_THE_WIRE)
def test_every_sync_is_answered_by_time_whatever_is_broken(
    drive: Drive, fault_text: FaultText, name: str, with_wire: bool
) -> None:
    if name in ON_THE_WIRE and not with_wire:
        pytest.skip("needs the wire model")
    faults = (SILENCES | ON_THE_WIRE)[name]
    run = drive(script(fault_text, faults, at=0.05, duration=0.2), with_wire=with_wire)
    for _ in range(200):
        records = run.cycles(1)
        assert records[-1].frame.can_id == 0x100
        assert sum(record.frame.can_id == 0x80 for record in records) == 1
    assert run.stamps_never_go_back
    run.cycles(500)  # what was a second late comes, too
    assert run.is_sound
    assert not run.bench.hooks.cards


@pytest.mark.parametrize(
    "name", (pytest.param(each, marks=() if each in TYPICAL else pytest.mark.slow) for each in SILENCES | ON_THE_WIRE)
)
def test_a_controlled_run_comes_to_its_end(fault_text: FaultText, name: str) -> None:
    faults = (SILENCES | ON_THE_WIRE)[name]
    text = script(fault_text, faults, at=0.1, duration=None)
    with limited(120.0) as is_over, Rig("konkuk1", faults=text, wire=name in ON_THE_WIRE) as rig:
        for _ in range(20):
            rig.run(0.1)
            assert not is_over.is_set()
    assert rig.state.name in ("DONE", "FAILED")


@pytest.mark.parametrize("fault", ["late-boot", "sdo-abort", "line-broken", "hang", "duplicate-node-id"])
def test_a_card_that_is_broken_before_the_start_does_not_keep_the_controller_waiting(
    fault_text: FaultText, fault: str
) -> None:
    with limited(120.0) as is_over, Rig("konkuk1", faults=fault_text("node.0x14", fault, None, None)) as rig:
        rig.run(0.5)
        assert not is_over.is_set()
    assert rig.state.name in ("DONE", "FAILED")


@pytest.mark.parametrize("with_wire", [False, True], ids=["", "wire"])
def test_the_same_seed_gives_the_same_records(drive: Drive, fault_text: FaultText, with_wire: bool) -> None:
    faults = [("can0.tx", "lost", {"probability": 0.3}), ("can0.rx", "repeated", {"probability": 0.2})]
    faults += [("bench.clock", "jitter", {}), ("node.0x14", "sync-missed", {"every": 3})]
    text = script(fault_text, faults, at=0.05, duration=0.2)
    logs = []
    for seed in (5, 5, 6):
        run = drive(text, with_wire=with_wire, seed=seed)
        run.cycles(150)
        logs.append([(record.time_ns, record.frame) for record in run.log])
    assert logs[0] == logs[1]
    assert [record for record in logs[0] if record[1].can_id != 0x294] != [r for r in logs[2] if r[1].can_id != 0x294]


def test_faults_that_never_begin_change_nothing(drive: Drive, fault_text: FaultText) -> None:
    sound, run = drive(), drive(fault_text("can0.tx", "lost", at=100.0))
    sound.cycles(100)
    run.cycles(100)
    assert run.log == sound.log


def test_a_second_run_counts_from_its_own_cycle_0(drive: Drive, fault_text: FaultText) -> None:
    run = drive("", is_started=False)
    run.start()
    run.cycles(1)  # even after a run of a single cycle
    run.send(nmt_frame(NmtCommand.STOP))
    run.cycles(100)
    run.inject(fault_text("can0.tx", "lost", at=0.1, duration=None, cob_id=0x294))
    run.send(nmt_frame(NmtCommand.START))
    assert sum(record.frame.can_id == 0x294 for record in run.cycles(80)) == 40


def test_a_set_that_waits_when_a_run_ends_waits_for_its_time_in_the_next(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("can0.tx", "lost", at=0.1, duration=None, cob_id=0x294))
    run.cycles(20)
    run.send(nmt_frame(NmtCommand.STOP))
    run.send(nmt_frame(NmtCommand.START))
    assert sum(record.frame.can_id == 0x294 for record in run.cycles(80)) == 40


@pytest.mark.parametrize("is_at_once", [True, False], ids=["the next run at once", "half a second between"])
@pytest.mark.parametrize("duration", [0.05, None], ids=["over", "still there"])
def test_what_a_fault_held_back_in_one_run_does_not_come_in_the_next(
    drive: Drive, fault_text: FaultText, is_at_once: bool, duration: float | None
) -> None:
    """A fault of the first run holds its frames back for 1 s; the second lasts that long, and has frames of its own."""
    run = drive(fault_text("can0.tx", "delayed", at=0.1, duration=duration, cob_id=0x294, delay=1000))
    run.cycles(60)
    run.send(nmt_frame(NmtCommand.STOP))
    if not is_at_once:
        run.bench.advance(run.bench.time_ns + 500_000_000)
        run.bench.advance(run.bench.time_ns)
    assert not [record for record in run.taken() if record.frame.can_id == 0x294]
    run.send(nmt_frame(NmtCommand.START))
    expected = 600 if duration else 600 - 400  # those of the first 200 cycles of it, where the fault is still there
    assert sum(record.frame.can_id == 0x294 for record in run.cycles(600)) == expected
    assert run.is_sound is bool(duration)


def test_the_first_of_a_pair_in_one_run_does_not_become_that_of_a_pair_in_the_next(
    drive: Drive, fault_text: FaultText
) -> None:
    run = drive(fault_text("can0.tx", "reordered", at=0.0, duration=None, cob_id=0x294))
    for cycles in (3, 4):
        counts = [sum(record.frame.can_id == 0x294 for record in run.cycles(1)) for _ in range(cycles)]
        assert counts == [0, 2, 0, 2][:cycles]
        run.send(nmt_frame(NmtCommand.STOP))
        run.send(nmt_frame(NmtCommand.START))


def test_frames_sent_behind_a_delayed_nmt_start_come_behind_it(drive: Drive, fault_text: FaultText) -> None:
    """All that cards receive comes 10 ms late on the wall clock, the start of the run with it.

    The outputs of the first cycle come in the fifth; those of the last four are on their way.
    """
    run = drive(fault_text("can0.rx", "delayed", at=None, duration=None, delay=10.0), Clock.WALL, is_started=False)
    run.send(nmt_frame(NmtCommand.START))
    records = run.cycles(50)
    assert run.bench.cycle == 46  # the fourth SYNC is the first of the run
    arrived = [record.frame.data for record in records if record.frame.can_id == 0x312]
    assert len(arrived) == 46
    assert arrived[:2] == [(17 << 7).to_bytes(2, "little") + bytes(6), (34 << 7).to_bytes(2, "little") + bytes(6)]


@pytest.mark.parametrize("with_wire", [False, True], ids=["", "wire"])
def test_while_no_sync_drives_a_run_nothing_is_late(drive: Drive, fault_text: FaultText, with_wire: bool) -> None:
    """Time stands still then: an answer to SDO, or the start of a run, that is to come later would never come."""
    text = "parallel = true\n" + "".join(
        fault_text(tap, "delayed", at=None, duration=None, delay=4.0) for tap in ("can0.rx", "can0.tx")
    )
    run = drive(text, with_wire=with_wire, is_started=False)
    run.taken()
    for _ in range(2):
        answered = run.send(Frame(0x614, bytes.fromhex("4000100000000000")))
        assert [record.frame.can_id for record in answered] == [0x614, 0x594]
        run.start()
        assert run.bench.is_operational
        assert not any(record.frame.can_id == 0x294 for record in run.cycles(2))  # now it is 4 ms late
        assert any(record.frame.can_id == 0x294 for record in run.cycles(1))
        run.bench.run_on()  # the master is lost, and the cards leave the run
        run.taken()


@pytest.mark.parametrize("tap", ["can0.rx", "can0.tx"])
def test_a_controller_gets_through_bring_up_whatever_is_late(fault_text: FaultText, tap: str) -> None:
    with Rig("konkuk1", faults=fault_text(tap, "delayed", at=None, duration=None)) as rig:
        rig.run(0.1)
        assert rig.time_s > 0.02, rig.reason


@pytest.mark.parametrize("line", ['when = "joint2.angle_deg < 1000"', 'when = "cycle < 50"', "cycle = 5"])
def test_conditions_and_cycles_count_only_while_a_run_is_on(drive: Drive, fault_text: FaultText, line: str) -> None:
    first = 5 if line == "cycle = 5" else 0
    text = fault_text("can0.tx", "lost", at=None, duration=None, cob_id=0x294).replace("[[set]]", f"[[set]]\n{line}")
    before = drive(text, is_started=False)
    before.bench.advance(100_000_000)
    between = drive()
    between.cycles(10)
    between.send(nmt_frame(NmtCommand.STOP))
    between.inject(text)
    between.bench.advance(between.bench.time_ns + 100_000_000)
    for run in (before, between):
        begun: list[int] = []
        run.bench.faults.on_event = lambda event, begun=begun: begun.append(event.cycle)
        run.taken()
        run.send(nmt_frame(NmtCommand.START))
        assert sum(record.frame.can_id == 0x294 for record in run.cycles(20)) == first
        assert begun == [first]


def test_a_manual_trigger_between_syncs_acts_with_the_next_one_on_the_wall_clock(
    drive: Drive, fault_text: FaultText
) -> None:
    text = fault_text("can0.tx", "lost", at=None, duration=None, cob_id=0x294).replace(
        "[[set]]", '[[set]]\nname = "mine"\nmanual = true'
    )
    run = drive(text, Clock.WALL)
    run.cycles(10)
    run.bench.advance(run.bench.time_ns + 1_000_000)
    run.taken()
    before = len([record for record in run.log if record.frame.can_id == 0x294])
    run.inject('trigger = "mine"')
    run.cycles(10)
    after = len([record for record in run.log if record.frame.can_id == 0x294])
    assert after == before
