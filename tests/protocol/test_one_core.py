"""A watcher keeps to one core; the processes that it starts do not."""

import os
import subprocess
import sys
import threading

import pytest

from canarm_protocol.transport.one_core import on_all_cores, on_one_core

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2, reason="there is one core, or no choice among them"
)
ASK = [sys.executable, "-c", "import os; print(*sorted(os.sched_getaffinity(0)))"]


def cores() -> list[int]:
    return sorted(os.sched_getaffinity(0))


def cores_of_a_process() -> list[int]:
    return [int(word) for word in subprocess.run(ASK, capture_output=True, check=True, text=True).stdout.split()]


def test_a_watcher_and_its_threads_keep_to_the_last_core_and_afterwards_have_all_again() -> None:
    before, seen = cores(), []
    with on_one_core():
        thread = threading.Thread(target=lambda: seen.append(cores()))
        thread.start()
        thread.join()
        assert cores() == before[-1:]
    assert seen == [before[-1:]]
    assert cores() == before


def test_a_process_that_a_watcher_starts_may_run_everywhere() -> None:
    before = cores()
    with on_one_core():
        assert cores_of_a_process() == before[-1:]
        with on_all_cores():
            assert cores_of_a_process() == before
        assert cores() == before[-1:]
    with on_all_cores():
        assert cores() == before


def test_a_watcher_that_may_use_one_core_only_stays_there() -> None:
    before = cores()
    os.sched_setaffinity(0, before[:1])
    try:
        with on_one_core(), on_all_cores():
            assert cores() == before[:1]
        assert cores() == before[:1]
    finally:
        os.sched_setaffinity(0, before)


def test_where_the_system_forbids_it_nothing_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(pid: int, mask: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    before = cores()
    monkeypatch.setattr(os, "sched_setaffinity", forbidden)
    with on_one_core(), on_all_cores():
        assert cores() == before
