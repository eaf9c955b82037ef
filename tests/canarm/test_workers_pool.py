"""The processes that share the runs of a matrix: nothing that ends one of them stalls the others or stays behind."""

import contextlib
import os
import platform
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from canarm.workers.memory import give_back
from canarm.workers.pool import LostWorkerError, results_of

HERE = Path(__file__).parent
DEADLINE_S = 60.0


class EndsWhilePickled:
    """A result that has its process told to end after its task, when the executor sends it: no task runs then."""

    def __reduce__(self) -> tuple[type[str], tuple[str]]:
        os.kill(os.getpid(), signal.SIGTERM)
        return str, ("sent",)


def end_while_pickled(_: int) -> EndsWhilePickled:
    return EndsWhilePickled()


def write_and_wait(folder: Path) -> None:
    (folder / str(os.getpid())).touch()
    try:
        threading.Event().wait(2 * DEADLINE_S)
    finally:
        (folder / f"{os.getpid()}.left").touch()


def test_a_worker_told_to_end_between_tasks_still_sends_what_it_has() -> None:
    results = results_of(end_while_pickled, [0, 1], 2)
    assert next(results)[1] == "sent"
    with contextlib.suppress(RuntimeError):  # the other task, where the same worker is to run it as well
        assert next(results)[1] == "sent"


def kill_own_process_once(folder: Path) -> str:
    """The first to come kills its process, as a kernel that is out of memory would."""
    with contextlib.suppress(FileExistsError):
        (folder / "killed").touch(exist_ok=False)
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def kill_own_process_always(name: str) -> str:
    if name == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    return name


def test_a_worker_that_is_killed_loses_no_task(tmp_path: Path) -> None:
    assert dict(results_of(kill_own_process_once, [tmp_path] * 6, 2)) == dict.fromkeys(range(6), "done")


def test_a_task_that_kills_its_worker_every_time_is_given_up_and_the_others_are_done() -> None:
    tasks = ["deadly", *(f"task {number}" for number in range(5))]
    results = dict(results_of(kill_own_process_always, tasks, 2, lambda task, error: f"{task}: {error}"))
    assert results.pop(0) == "deadly: its process was ended from outside"
    assert results == {number: tasks[number] for number in range(1, 6)}


def test_without_anybody_to_tell_a_lost_task_is_an_error() -> None:
    with pytest.raises(LostWorkerError, match="ended from outside"):
        list(results_of(kill_own_process_always, ["deadly", "task"], 2))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_outlives_the_process_that_wants_its_results(number: signal.Signals, tmp_path: Path, until) -> None:
    script = (
        "from test_workers_pool import results_of, write_and_wait\n"
        "import pathlib, sys\n"
        "if __name__ == '__main__':\n"
        "    list(results_of(write_and_wait, [pathlib.Path(sys.argv[1])] * 4, 2))\n"
    )
    process = subprocess.Popen([sys.executable, "-c", script, tmp_path], cwd=HERE, stderr=subprocess.DEVNULL)
    until(lambda: len(list(tmp_path.iterdir())) == 2, "beginning of two tasks")
    workers = [int(path.name) for path in tmp_path.iterdir()]
    process.send_signal(number)
    assert process.wait(DEADLINE_S) != 0
    until(lambda: not any(map(is_alive, workers)), "end of the workers")
    assert sorted(path.name for path in tmp_path.glob("*.left")) == sorted(f"{pid}.left" for pid in workers)


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


@pytest.mark.skipif(sys.platform != "linux" or platform.libc_ver()[0] != "glibc", reason="other C libraries keep less")
def test_memory_that_is_free_but_torn_goes_back_to_the_system() -> None:
    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    pieces = [bytes(1000) for _ in range(100_000)]
    last = pieces.pop()  # holds the end of the heap, so that the C library cannot shorten it
    del pieces
    before = resident()
    give_back()
    assert before - resident() > 50_000_000, len(last)
