"""A rig has several futures, each the same to the bit as if the run had gone on alone."""

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from canarm import Rig
from canarm.rig import branching
from canarm.rig.rig import Rig as PlainRig
from canarm.usage import UsageError
from canarm.workers.forking import CAN_FORK
from canarm.workers.pool import LostWorkerError

pytestmark = pytest.mark.skipif(not CAN_FORK, reason="this system has no fork")

Future = tuple[list[object], bytes, bytes]


def half_a_second(rig: PlainRig) -> Future:
    """Frames, true angles and what the law has adapted, to the last bit."""
    rig.run(0.5)
    angles = b"".join(joint.true_angle_rad.tobytes() for joint in rig.joints.values())
    internals = rig.controller.loop.internals()
    return list(rig.frames), angles, repr(sorted((name, list(row)) for name, row in internals.items())).encode()


@pytest.mark.parametrize("cell", ["konkuk1", pytest.param("rhino-pair", marks=pytest.mark.slow)])
def test_a_branch_goes_on_to_the_bit_as_the_run_itself(cell: str) -> None:
    with Rig(cell, seed=4) as rig:
        rig.run(0.3)
        branched = rig.branch(half_a_second)
        again = rig.branch(half_a_second)
        itself = half_a_second(rig)
    with Rig(cell, seed=4) as alone:
        alone.run(0.3)
        assert branched == again == itself == half_a_second(alone)


def test_a_fault_in_a_branch_leaves_the_run_as_it_is() -> None:
    def broken(rig: PlainRig) -> tuple[bool, int]:
        rig.inject("joint2.tachometer", "stuck")
        rig.run(0.5)
        return bool(rig.detected("tachometer-stuck")), len(rig.fault_events)

    with Rig(seed=1) as rig:
        rig.run(0.5)
        assert rig.branch(broken) == (True, 1)
        assert rig.fault_events == []
        assert rig.time_s == pytest.approx(0.5, abs=0.003)


def test_what_a_branch_raises_is_raised_here() -> None:
    class Unpicklable(Exception):
        def __reduce__(self) -> str:
            raise TypeError("not to be pickled")

    def refuse(rig: PlainRig) -> None:
        raise Unpicklable("no")

    with Rig() as rig:
        rig.run(0.1)
        with pytest.raises(ZeroDivisionError):
            rig.branch(lambda rig: 1 / 0)
        with pytest.raises(UsageError, match="branch: Unpicklable: no"):
            rig.branch(refuse)


class Fragile:
    """Can be written, and not read."""

    def __reduce__(self) -> tuple[object, ...]:
        return int, ("no number",)


@pytest.mark.parametrize(
    "do",
    [
        lambda rig: rig,
        lambda rig: rig.joints,
        lambda rig: rig.joints["joint2"],
        lambda rig: {"rig": [rig]},
        lambda rig: lambda: None,
        lambda rig: Fragile(),
    ],
    ids=["rig", "joints", "joint", "within", "function", "fragile"],
)
def test_what_cannot_leave_a_branch_is_answered_by_what_can(do: Callable[[PlainRig], object]) -> None:
    with Rig() as rig:
        rig.run(0.01)
        with pytest.raises(UsageError, match="return numbers, arrays or a DataFrame, not the rig or its parts"):
            rig.branch(do)
        assert rig.branch(lambda rig: rig.to_dataframe()).shape[0] == 4


def test_a_branch_that_is_killed_says_so_and_the_run_goes_on() -> None:
    with Rig() as rig:
        rig.run(0.1)
        with pytest.raises(LostWorkerError):
            rig.branch(lambda rig: os.kill(os.getpid(), signal.SIGKILL))
        rig.run(0.1)
        assert rig.state.name == "RUNNING"


def test_a_branch_writes_nothing_into_the_runs_folder(tmp_path: Path) -> None:
    with Rig(seed=2, out=tmp_path / "branched") as rig:
        rig.run(0.3)
        rig.branch(half_a_second)
        rig.run(0.3)
    with Rig(seed=2, out=tmp_path / "alone") as rig:
        rig.run(0.3)
        rig.run(0.3)
    for name in ("can0.log", "signals/robot.csv", "signals/controller.csv"):
        assert (tmp_path / "branched" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()


def test_where_there_is_no_fork_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(branching, "CAN_FORK", False)
    with Rig() as rig:
        rig.run(0.1)
        with pytest.raises(UsageError, match="make two rigs"):
            rig.branch(half_a_second)
