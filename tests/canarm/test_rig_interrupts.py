"""Ctrl-C where the user's own code runs, and what several threads may do with one rig."""

import threading
from collections.abc import Sequence
from pathlib import Path

import pytest

from canarm import Rig
from canarm_controller.laws.base import Cycle
from canarm_controller.laws.pd import Pd
from canarm_controller.run.state import State
from canarm_protocol.runs.run_folder import read_run_file

pytest_plugins = ["pytester"]
AT = 40
"""The cycle in which Ctrl-C lands."""


class InUpdate(Pd):
    """Where it mostly lands."""

    name = "in-update"

    def update(self, cycle: Cycle) -> Sequence[float]:
        if cycle.tick == AT:
            raise KeyboardInterrupt
        return super().update(cycle)


class InInternals(Pd):
    """The last code of the law in a cycle."""

    name = "in-internals"
    calls = 0

    def internals(self) -> dict[str, list[float]]:
        self.calls += 1
        if self.calls == AT:
            raise KeyboardInterrupt
        return {}


class InStart(Pd):
    """Before cycle 0: there is nothing to stop yet."""

    name = "in-start"

    def start(self, *arguments: Sequence[float]) -> None:
        raise KeyboardInterrupt


@pytest.mark.parametrize(("law", "method"), [(InUpdate, "update"), (InInternals, "internals"), (InStart, "start")])
def test_ctrl_c_in_a_law_is_raised_once_the_robot_is_safe_and_the_record_is_whole(
    law: type[Pd], method: str, tmp_path: Path
) -> None:
    with pytest.raises(KeyboardInterrupt), Rig(law=law, out=tmp_path / "run") as rig:
        rig.run(1.0)
    assert rig.state is State.FAILED
    assert rig.torque_is_off
    assert rig.reason is not None
    assert rig.reason.endswith(f"KeyboardInterrupt in {method}() of law {law.__name__}")
    assert read_run_file(tmp_path / "run")["summary"]["reason"] == rig.reason


def test_ctrl_c_in_the_last_cycle_of_a_run_waits_for_the_safe_stop_too() -> None:
    with Rig(law=InInternals) as rig:
        with pytest.raises(KeyboardInterrupt):
            rig.run((AT - 1) * rig.cell.bus.cycle_s)
        assert rig.state is State.FAILED
        rig.run(0.1)  # it has been raised, and the run is over
        assert rig.detections[-1].detector == "interrupted"


def test_a_law_that_ends_the_program_has_failed_as_any_other() -> None:
    class Leaving(Pd):
        def update(self, cycle: Cycle) -> Sequence[float]:
            raise SystemExit(3)

    with Rig(law=Leaving) as rig:
        rig.run(0.1)
        assert rig.reason is not None
        assert rig.reason.startswith("law-failed: law Leaving: update() fails")


def test_ctrl_c_in_a_law_ends_a_session_of_pytest(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        from canarm_controller.laws.pd import Pd

        class Slow(Pd):
            name = "slow"

            def update(self, cycle):
                raise KeyboardInterrupt

        def test_first(canarm_rig):
            canarm_rig(law=Slow).run(0.1)

        def test_second():
            pass
        """
    )
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider", no_reraise_ctrlc=True)
    assert result.ret == pytest.ExitCode.INTERRUPTED
    result.stdout.fnmatch_lines(["*KeyboardInterrupt*", "*no tests ran*"])


def test_a_second_thread_that_runs_a_rig_is_refused_and_the_first_goes_on() -> None:
    begun, may_go_on = threading.Event(), threading.Event()
    refusals: list[str] = []

    class Waiting(Pd):
        def update(self, cycle: Cycle) -> Sequence[float]:
            begun.set()
            may_go_on.wait(60.0)
            return super().update(cycle)

    with Rig(law=Waiting) as rig:

        def refused() -> None:
            begun.wait(60.0)
            for call in (lambda: rig.run(0.1), rig.finish, lambda: rig.branch(lambda copy: None)):
                try:
                    call()
                except ValueError as error:
                    refusals.append(str(error))
            may_go_on.set()

        other = threading.Thread(target=refused)
        other.start()
        rig.run(0.1)
        other.join()
        assert rig.reason is None
        assert rig.joints["joint2"].time_s.size == round(0.1 / rig.cell.bus.cycle_s)
    assert refusals == [
        "run: is running already in another thread",
        "finish: run is running in another thread",
        "branch: run is running in another thread",
    ]


def test_a_law_that_runs_its_own_rig_is_refused() -> None:
    rigs: list[Rig] = []

    class Recursive(Pd):
        def update(self, cycle: Cycle) -> Sequence[float]:
            rigs[0].run(0.1)
            return super().update(cycle)

    with Rig(law=Recursive) as rig:
        rigs.append(rig)
        rig.run(0.1)
        assert rig.reason is not None
        assert "run: is running already, and this comes from within it" in rig.reason
