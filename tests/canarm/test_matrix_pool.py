"""The processes that share the runs of a matrix: nothing that ends one of them stalls the others or stays behind."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from canarm.matrix.pool import results_of

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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_outlives_the_process_that_wants_its_results(number: signal.Signals, tmp_path: Path, until) -> None:
    script = (
        "from test_matrix_pool import results_of, write_and_wait\n"
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
