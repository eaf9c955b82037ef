"""Faults that users declare: where they are found, what is refused of them, and what one that fails does."""

import math
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from canarm_emulator.bench_node.fault_objects import event_text
from canarm_emulator.faults import declaration
from canarm_emulator.faults.declaration import Context, JointFault, NodeFault, NodeHandle, SignalFault, TapKind
from canarm_emulator.faults.parameters import choice, level, of_tap, parameter
from canarm_emulator.robot.truth import JointTruth, Truth
from canarm_protocol.canopen.frames import sync_frame
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.fault_events import event_details
from tests.emulator.fault_run import (
    ACTIVE,
    CELL,
    ENDED,
    Run,
    fault_set,
)

# Faults of users


@pytest.fixture
def own_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is declared in a test is forgotten after it."""
    declaration.declared_faults()
    monkeypatch.setattr(declaration, "_DECLARED", dict(declaration._DECLARED))


@pytest.mark.usefixtures("own_faults")
def test_a_fault_declared_in_any_module_can_be_injected() -> None:
    @dataclass
    class Own(SignalFault, name="own", acts_on=[TapKind.LATCH]):
        """Both bits are off."""

        def apply(self, value: float, now_ns: int) -> float:
            return 0.0

    run = Run()
    run.inject(fault_set("a", "cycle = 3", fault="own"))
    run.cycles(6)
    assert [codes[0] != 0.0 for codes in run.codes[1:]] == [True, True, False, False, False]
    assert Own.declared_at.startswith(f"{__file__}:")


@pytest.mark.usefixtures("own_faults")
def test_a_name_that_is_taken_at_a_kind_of_tap_is_refused_with_both_places() -> None:
    line = (sys._getframe().f_lineno) + 3
    with pytest.raises(FaultError) as caught:

        class Stuck(SignalFault, name="stuck", acts_on=[TapKind.SENSOR]):
            pass

    text = str(caught.value)
    assert text.startswith(f"{__file__}:{line}: fault 'stuck': the name is taken at SENSOR (voltage of a sensor) by ")
    assert re.search(r"signal\.py:\d+; choose another name$", text)
    assert declaration.declared_faults()["stuck", TapKind.SENSOR].__module__.endswith("kinds.signal")


@pytest.mark.usefixtures("own_faults")
@pytest.mark.parametrize(
    ("acts_on", "message"),
    [
        ([], "acts_on is empty"),
        (
            [TapKind.NODE],
            "acts_on has NODE; with its base it can act on DAC_CODE, LATCH, OPAMP, CURRENT, SENSOR, ADC_CODE",
        ),
    ],
)
def test_a_fault_that_could_act_nowhere_is_refused(acts_on: list[TapKind], message: str) -> None:
    with pytest.raises(FaultError, match=message):
        type(SignalFault)("Own", (SignalFault,), {"__module__": __name__}, name="own", acts_on=acts_on)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: parameter("how much", 0.5, 0.0, 1.0, 2.0),
            "unit = 0.5: must be text; the call is parameter(about, unit",
        ),
        (lambda: parameter("how much", "V", "0.5", 0.0, 1.0), "default = '0.5': must be a number"),
        (lambda: parameter("how much", "V", 0.5, 1.0, 0.0), "minimum = 1.0 is above maximum = 0.0"),
        (lambda: parameter("how much", "V", 5.0, 0.0, 1.0), "default = 5.0: must be from 0.0 to 1.0"),
        (lambda: of_tap(0.5, "how much", 0.0, 1.0), "about = 0.5: must be text; the call is of_tap(about, default"),
        (lambda: level("where", 1.5), "default = 1.5: must be from 0.0 to 1.0; the call is level(about, default)"),
        (lambda: choice("which", "one"), "choices = 'one': must be words"),
    ],
)
def test_a_wrong_declaration_of_a_parameter_names_file_line_and_class(call: Callable[[], object], message: str) -> None:
    with pytest.raises(FaultError) as caught:

        class Own(SignalFault):
            value = call()

    text = str(caught.value)
    assert text.startswith(f"{__file__}:")
    assert message in text
    with pytest.raises(FaultError, match=rf"{re.escape(__file__)}:\d+: class Bad: about = 1: must be text"):

        class Bad(SignalFault):
            value: float = level(1, 0.5)  # type: ignore[arg-type]


@pytest.mark.usefixtures("own_faults")
def test_a_fault_that_is_no_dataclass_or_cannot_be_made_is_refused_by_name_and_place() -> None:
    class Plain(SignalFault, name="plain", acts_on=[TapKind.LATCH]):
        """No dataclass."""

        def apply(self, value: float, now_ns: int) -> float:
            return value

    @dataclass
    class Unmade(SignalFault, name="unmade", acts_on=[TapKind.LATCH]):
        """Cannot be made."""

        def __post_init__(self) -> None:
            raise KeyError("gain")

        def apply(self, value: float, now_ns: int) -> float:
            return value

    run = Run()
    with pytest.raises(FaultError, match=r"test_faults_of_users.py:\d+: class Plain: must be a @dataclass"):
        run.inject(fault_set("a", fault="plain"))
    with pytest.raises(FaultError, match=r"unmade at joint2.latch: cannot be made: KeyError: 'gain' \(.*\.py:\d+\)"):
        run.inject(fault_set("a", fault="unmade"))
    assert run.states() == {}


@pytest.mark.usefixtures("own_faults")
@pytest.mark.parametrize("where", ["begin", "apply", "no number", "nan"])
def test_a_faulty_fault_ends_and_the_bench_goes_on(where: str) -> None:
    @dataclass
    class Faulty(SignalFault, name="faulty", acts_on=[TapKind.LATCH]):
        """Fails in its third cycle, or as it begins."""

        def begin(self, context: Context) -> None:
            self._fails_ns = context.now_ns + 2 * context.cycle_ns
            if where == "begin":
                raise KeyError("gain")

        def apply(self, value: float, now_ns: int) -> float:
            if now_ns < self._fails_ns:
                return 0.0
            return {"no number": None, "nan": math.nan}[where]  # type: ignore[return-value]

    run, events = Run(), []
    run.bench.faults.on_event = events.append
    run.inject(fault_set("a", "cycle = 5\nduration = 0.5\nrepeat = 2", fault="faulty"))
    run.inject(fault_set("b", "cycle = 5", tap="joint3.latch"))
    run.cycles(20)
    assert run.states() == {"a": ENDED, "b": ACTIVE}
    assert run.bench.faults.active == 1
    begin, end = (event for event in events if event.set_name == "a")
    assert (begin.cycle, begin.is_begin, begin.failure) == (5, True, "")
    assert (end.cycle, end.is_begin) == (5 if where == "begin" else 7, False)
    kind = {"begin": "KeyError: 'gain'", "apply": "KeyError: 'apply'", "no number": "TypeError: apply() returned None"}
    assert end.failure.startswith(f"failed: {kind.get(where, 'ValueError: apply() returned nan')}")
    assert re.search(rf"\({re.escape(__file__)}:\d+\)$", end.failure) or where in ("no number", "nan")
    assert [codes[0] != 0.0 for codes in run.codes[9:]] == [True] * 11
    assert event_details(end)["failure"] == end.failure
    assert event_text(end).endswith(end.failure)


@pytest.mark.usefixtures("own_faults")
def test_a_truth_that_cannot_be_ends_its_fault() -> None:
    @dataclass
    class Weightless(JointFault, name="weightless", acts_on=[TapKind.LINK]):
        """What the change returns is no joint."""

        def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
            return None  # type: ignore[return-value]

    run, events = Run(), []
    run.bench.faults.on_event = events.append
    run.inject(fault_set("a", "cycle = 2", tap="joint2.link", fault="weightless"))
    run.cycles(5)
    assert events[-1].failure.startswith("failed: TypeError: change() returned None: must be a JointTruth")
    assert run.bench.world.truth == Truth.from_settings(CELL)


@pytest.mark.usefixtures("own_faults")
@pytest.mark.parametrize(
    ("filter_name", "failure"),
    [("set_sync_filter", "KeyError: 'sync'"), ("set_send_filter", "TypeError: the send filter returned 7")],
)
def test_a_filter_that_fails_ends_its_fault_and_lets_all_pass(filter_name: str, failure: str) -> None:
    def no_sync(now_ns: int) -> bool:
        raise KeyError("sync")

    @dataclass
    class Sieve(NodeFault, name="sieve", acts_on=[TapKind.NODE]):
        """Its filter fails at the first SYNC or frame."""

        def act(self, node: NodeHandle, now_ns: int) -> None:
            getattr(node, filter_name)(no_sync if filter_name == "set_sync_filter" else lambda frame: 7)

        def end(self, node: NodeHandle, now_ns: int) -> None:
            getattr(node, filter_name)(None)

    run, events = Run(), []
    run.bench.faults.on_event = events.append
    run.inject(fault_set("a", "cycle = 5", tap="node.0x14", fault="sieve"))
    run.cycles(10)
    assert run.states() == {"a": ENDED}
    assert events[-1].failure.startswith(f"failed: {failure}")
    run.bench.receive(sync_frame(None))
    assert {0x294, 0x394} <= {record.frame.can_id for record in run.bench.records}


def test_faults_of_other_packages_are_found_by_their_entry_point(tmp_path: Path) -> None:
    (tmp_path / "blind_faults.py").write_text(
        "from dataclasses import dataclass\n"
        "from canarm_emulator.faults.declaration import SignalFault, TapKind\n"
        "@dataclass\n"
        "class Blind(SignalFault, name='blind', acts_on=[TapKind.SENSOR]):\n"
        "    '''Sees nothing.'''\n"
        "    def apply(self, value, now_ns):\n"
        "        return 0.0\n"
    )
    info = tmp_path / "blind_faults-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: blind-faults\nVersion: 1.0\n")

    def declared(module: str) -> str:
        (info / "entry_points.txt").write_text(f"[canarm.faults]\nblind = {module}\n")
        program = (
            "from canarm_emulator.faults.declaration import declared_faults\n"
            "from canarm_protocol.errors import FaultError\n"
            "try:\n    print(sorted(kind.name for name, kind in declared_faults() if name == 'blind'))\n"
            "except FaultError as error:\n    print(error)\n"
        )
        environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
        return subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True, timeout=120
        ).stdout.strip()

    assert declared("blind_faults") == "['SENSOR']"
    (tmp_path / "leaving.py").write_text("raise SystemExit(0)\n")
    assert declared("leaving") == "faults of entry point 'blind' (leaving): SystemExit: 0"
    complaint = declared("no_such_module")
    assert complaint == (
        "faults of entry point 'blind' (no_such_module): ModuleNotFoundError: No module named 'no_such_module'"
    )
