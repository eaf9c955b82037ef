"""Faults and lockstep: silence stalls nothing, runs are repeatable, and times count from each run's own start.

TIME (0x100) after every SYNC is what a controller in lockstep waits for.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from canarm import Rig
from canarm_protocol.clock import Clock
from canarm_protocol.frames import NmtCommand, nmt_frame

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


@pytest.mark.parametrize("name", SILENCES | ON_THE_WIRE)
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
