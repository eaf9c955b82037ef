"""What a run does to interpreter and process, and that it is undone."""

import ctypes
import gc
import os
import sys

import pytest

from canarm.rig.rig import Rig
from canarm_protocol.transport import realtime
from canarm_protocol.transport.realtime import COLLECT_CYCLES, PATIENCE, Collector, ask_for_realtime, undisturbed
from canarm_protocol.transport.time_slice import LEAST_NS, set_time_slice

PR_GET_TIMERSLACK = 30
PERIOD_NS = 2_500_000


class Collections:
    """A clock, and collections that take their time on it."""

    def __init__(self, cost_ns: int) -> None:
        self.now_ns, self.cost_ns, self.made = 0, cost_ns, 0

    def clock(self) -> int:
        return self.now_ns

    def collect(self) -> int:
        self.now_ns += self.cost_ns
        self.made += 1
        return 0


def made_after(cycles: int, cost_ns: int, left_ns: int) -> int:
    collections = Collections(cost_ns)
    collector = Collector(collections.clock, collections.collect)
    for _ in range(cycles):
        collector.cycle_done(left_ns)
    assert collector.collections == collections.made
    return collections.made


@pytest.mark.parametrize(("cycles", "made"), [(399, 0), (400, 1), (799, 1), (4000, 10)])
def test_garbage_is_collected_once_a_second(cycles: int, made: int) -> None:
    assert COLLECT_CYCLES * PERIOD_NS == 1_000_000_000
    assert made_after(cycles, cost_ns=100_000, left_ns=1_500_000) == made


def test_a_collection_that_may_not_fit_waits_for_a_cycle_with_more_time() -> None:
    collections = Collections(cost_ns=600_000)
    collector = Collector(collections.clock, collections.collect)
    for _ in range(400):
        collector.cycle_done(1_500_000)
    for _ in range(1000):
        collector.cycle_done(1_500_000)
    assert collections.made == 1  # three times 0.6 ms do not fit into 1.5 ms
    collector.cycle_done(1_800_000)
    assert collections.made == 2


def test_a_collection_that_never_fits_is_made_all_the_same_now_and_then() -> None:
    """The first one cannot know what it costs; the others come every ten seconds."""
    assert made_after(400 + 2 * PATIENCE * COLLECT_CYCLES, cost_ns=50_000_000, left_ns=1_500_000) == 3


@pytest.mark.parametrize("had_frozen", [False, True])
def test_a_run_is_not_disturbed_by_collections_and_leaves_them_as_they_were(had_frozen: bool) -> None:
    gc.unfreeze()
    if had_frozen:
        gc.freeze()
    assert gc.isenabled()
    with undisturbed():
        assert not gc.isenabled()
        assert gc.get_freeze_count() > 0
    assert gc.isenabled()
    assert (gc.get_freeze_count() > 0) is had_frozen


def test_a_program_that_collects_by_itself_may_go_on_to_do_so() -> None:
    gc.disable()
    try:
        with undisturbed():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_a_run_that_fails_leaves_collection_on() -> None:
    with pytest.raises(KeyboardInterrupt), undisturbed():
        raise KeyboardInterrupt
    assert gc.isenabled()


@pytest.mark.skipif(sys.platform != "linux", reason="timer slack is Linux's")
def test_timers_fire_on_time_during_a_run_and_as_before_after_it() -> None:
    prctl = ctypes.CDLL(None).prctl
    before_ns = prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0)
    with undisturbed():
        assert prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0) == min(before_ns, 1)
    assert prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0) == before_ns


def slice_ns() -> int:
    now_ns = set_time_slice(LEAST_NS)
    if now_ns:
        set_time_slice(now_ns)
    return now_ns


@pytest.mark.skipif(slice_ns() == 0, reason="this kernel gives threads no slices of their own")
def test_a_loop_has_the_shortest_slice_of_time_and_afterwards_that_of_before() -> None:
    """So that it runs when it wakes, whoever else runs."""
    before_ns, nice = slice_ns(), os.nice(0)
    assert before_ns > LEAST_NS
    with undisturbed():
        assert slice_ns() == LEAST_NS
    assert slice_ns() == before_ns
    assert os.nice(0) == nice


def test_in_a_real_time_class_and_on_other_systems_there_are_no_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    assert set_time_slice(LEAST_NS) == 0


@pytest.mark.parametrize("law", ["pd", "computed-torque", "mras", "mras-lyapunov", "slotine-li"])
def test_the_loop_leaves_nothing_for_a_collection(law: str) -> None:
    with Rig("konkuk1", law=law) as rig:
        rig.run(0.25)
        gc.collect()
        gc.disable()
        try:
            rig.run(0.5)
            assert gc.collect() == 0
        finally:
            gc.enable()


def test_a_real_time_class_that_is_refused_is_a_line_and_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse, raising=False)
    monkeypatch.setattr(realtime, "_memory_lock", lambda: "Cannot allocate memory")
    assert ask_for_realtime() == [
        "real-time class: Operation not permitted; allow it with `ulimit -r 49` or CAP_SYS_NICE; "
        "the run goes on without",
        "memory lock: Cannot allocate memory; the run goes on without",
    ]


def test_a_system_without_the_class_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_setscheduler", raising=False)
    monkeypatch.setattr(sys, "platform", "darwin")
    assert ask_for_realtime() == [
        "real-time class: darwin has no SCHED_FIFO; the run goes on without",
        "memory lock: not known how on darwin; the run goes on without",
    ]
