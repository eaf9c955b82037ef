"""The pytest plugin as users meet it: pytest in a separate process and folder."""

import os
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0 * float(os.environ.get("PATIENCE", "1"))

FAILING = """
def test_fails(canarm_rig):
    rig = canarm_rig(law="mras")
    rig.inject("joint2.wire", "wire-broken", at=0.5)
    rig.run(1.0)
    assert rig.detected("heartbeat-lost").within(0.025)
"""
PASSING = """
def test_passes(canarm_rig):
    rig = canarm_rig(law="pd")
    rig.run(0.1)
    assert rig.summary().seed == {seed}
"""


@pytest.fixture
def run(pytester):
    """Run pytest on a test file with this text, in this process, where everything is imported."""

    def run_pytest(text: str, *options: str) -> pytest.RunResult:
        pytester.makepyfile(text)
        return pytester.runpytest_inprocess("-p", "no:cacheprovider", *options)

    return run_pytest


@pytest.fixture
def run_process(pytester):
    """Run pytest on a test file with this text, in a process of its own."""

    def run_pytest(text: str, *options: str) -> pytest.RunResult:
        pytester.makepyfile(text)
        return pytester.runpytest_subprocess("-p", "no:cacheprovider", *options, timeout=PATIENCE_S)

    return run_pytest


def kept(result: pytest.RunResult) -> Path:
    """The run folder that the report names."""
    (line,) = (line for line in result.outlines if line.startswith("run folder: "))
    return Path(line.removeprefix("run folder: "))


def test_a_test_that_fails_names_its_run_folder_and_plot_and_what_happened(run) -> None:
    result = run(FAILING)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "E*assert <heartbeat-lost not detected after joint2.wire wire-broken; *",
            "*- canarm -*",
            "run folder: *",
            "plot: *joints.svg",
            "*0.5000 s  fault begins: joint2.wire wire-broken",
            "stopped: *",
        ]
    )
    folder = kept(result)
    assert {"run.json", "can0.log", "events.jsonl", "joints.svg"} <= {path.name for path in folder.iterdir()}
    assert ElementTree.parse(folder / "joints.svg").getroot().tag == "{http://www.w3.org/2000/svg}svg"
    texts = (folder / "joints.svg").read_text()
    assert all(word in texts for word in ("reference", "true", "measured", "current", "joint2.wire wire-broken"))


def test_a_relative_canarm_out_is_of_where_pytest_starts_wherever_the_test_goes(run, pytester) -> None:
    (pytester.path / "elsewhere").mkdir()
    text = """
    def test_goes(canarm_rig, monkeypatch):
        monkeypatch.chdir("elsewhere")
        canarm_rig(law="pd").run(0.1)
        assert 0
    """
    for options in ([], ["-n", "2"]):
        result = run(text, "--canarm-out=kept", *options)
        result.assert_outcomes(failed=1)
        assert kept(result).parent == pytester.path / "kept"
    assert not list((pytester.path / "elsewhere").iterdir())


def test_the_plot_of_a_run_longer_than_its_history_shows_the_fault(run) -> None:
    text = """
    def test_long(canarm_rig):
        rig = canarm_rig(law="pd", history_s=0.5)
        rig.inject("joint2.current_sense", "offset", at=0.2)
        rig.run(2.0)
        assert 0
    """
    root = ElementTree.parse(kept(run(text)) / "joints.svg").getroot()
    lines = [each.get("points", "").split() for each in root.iter("{http://www.w3.org/2000/svg}polyline")]
    assert lines
    assert min(len(points) for points in lines) > 0.5 / 0.0025  # from the beginning to 0.5 s after the detection


@pytest.mark.slow
def test_canarm_out_says_where_failures_are_kept_and_keeps_them_all(run, tmp_path: Path) -> None:
    out = tmp_path / "kept"
    for name in ("test_fails", "test_fails-2"):
        result = run(FAILING, f"--canarm-out={out}")
        assert kept(result) == out / name
    assert sorted(path.name for path in out.iterdir()) == ["test_fails", "test_fails-2"]


def test_nothing_is_kept_of_a_test_that_passes(run, pytester, tmp_path: Path) -> None:
    run(PASSING.format(seed=0), f"--canarm-out={tmp_path / 'kept'}", f"--basetemp={tmp_path / 'base'}").assert_outcomes(
        passed=1
    )
    assert not (tmp_path / "kept").exists()
    assert not list((tmp_path / "base").rglob("can0.log"))


def test_the_seed_is_an_option(run) -> None:
    run(PASSING.format(seed=7), "--canarm-seed=7").assert_outcomes(passed=1)


def test_a_rig_is_finished_after_its_test(run) -> None:
    text = """
    rigs = []
    def test_one(canarm_rig):
        rigs.extend(canarm_rig(law="pd") for _ in range(2))
        for rig in rigs:
            rig.run(0.1)
    def test_two():
        assert [rig.state.name for rig in rigs] == ["DONE", "DONE"]
    """
    run(text).assert_outcomes(passed=2)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--canarm-bus=virtul", "must be virtual, or socketcan:vcan0,vcan1"),
        ("--canarm-bus=socketcan:vcan0", "must be virtual, or socketcan:vcan0,vcan1"),
        ("--canarm-seed=-1", "--canarm-seed -1: must be 0 or more, and at most 9223372036854775807"),
        ("--canarm-out=a_file", "--canarm-out a_file: File exists; must be a folder to write in"),
        ("--canarm-out=a_file/kept", "--canarm-out a_file/kept: "),
    ],
)
def test_an_option_that_cannot_be_is_refused_before_any_test(run, pytester, option: str, message: str) -> None:
    (pytester.path / "a_file").write_text("")
    result = run(PASSING.format(seed=0), option)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert message in result.stderr.str()


def test_tests_that_use_no_fixture_of_it_import_next_to_nothing(run_process) -> None:
    text = """
    import sys
    def test_imports():
        loaded = {name for name in sys.modules if name.split(".")[0].startswith(("canarm", "mujoco", "can"))}
        assert {name for name in loaded if name.split(".")[0] in ("mujoco", "can", "canopen")} == set()
        light = {"canarm", "canarm.pytest_plugin", "canarm_protocol", "canarm_protocol.faces"}
        assert {name for name in loaded if name.startswith("canarm")} == light
    """
    run_process(text).assert_outcomes(passed=1)


@pytest.mark.slow
def test_over_a_bus_the_same_test_gives_the_same_answers(run) -> None:
    text = """
    def test_same(canarm_rig):
        rig = canarm_rig("konkuk1", law="mras", seed=3, truth={"joint3.mass": 0.9})
        rig.inject("can0.tx", "lost", cob_id=0x294, at=1.0)
        rig.run(3.0)
        print("ANSWER", rig.state.name, rig.torque_is_off, rig.detected(), rig.reason)
        print("ANSWER", rig.joints["joint2"].stays_below("current_a", 1.5))
        print("ANSWER", rig.joints["joint2"].peak_current_a.__round__(3), rig.fault_events[0])
    """
    answers = []
    for option in ("--canarm-seed=0", "--canarm-bus=virtual"):
        result = run(text, "-s", option)
        result.assert_outcomes(passed=1)
        answers.append([line[line.index("ANSWER") :] for line in result.outlines if "ANSWER" in line])
    assert answers[0] == answers[1]
    assert len(answers[0]) == 3
    assert "inputs-missing" in answers[0][0]


@pytest.mark.slow
def test_over_a_bus_what_is_not_to_be_had_is_said(run) -> None:
    text = """
    import pytest
    from canarm.usage import UsageError
    from canarm_protocol.errors import FaultError
    def test_refusals(canarm_rig):
        rig = canarm_rig(law="pd")
        with pytest.raises(FaultError, match="no tap 'joint9.tachometer'"):
            rig.inject("joint9.tachometer", "stuck")
        rig.run(0.1)
        for use in (lambda: rig.run(1.0), lambda: rig.inject("joint2.tachometer", "stuck"), lambda: rig.controller):
            with pytest.raises(UsageError, match="over a bus"):
                use()
    """
    run(text, "--canarm-bus=virtual").assert_outcomes(passed=1)


def test_the_buses_of_socketcan_reach_both_processes() -> None:
    from canarm.bus_choice import BusChoice

    flags = BusChoice.parse("socketcan:vcan0,vcan1").flags
    assert flags == ["-i", "socketcan", "-c", "vcan0", "--bench-interface", "socketcan", "--bench-channel", "vcan1"]
    assert BusChoice.parse("virtual").flags == []


PROGRAM = """\
import sys, can
with can.Bus(interface="canarm", channel="can0", host="127.0.0.1", port=int(sys.argv[1])) as bus:
    bus.send(can.Message(arbitration_id=0, data=[1, 0x12], is_extended_id=False))
    bus.send(can.Message(arbitration_id=0x701, data=[5], is_extended_id=False))
    print("sent", flush=True)
    while bus.recv(1.0) is None or len(sys.argv) > 2:
        pass
"""


def test_the_reactions_of_any_program_are_seen_from_the_bus(run, pytester) -> None:
    (pytester.path / "program.py").write_text(PROGRAM)
    text = """
    import sys
    from canarm_protocol.canopen.frames import NmtCommand, NmtState
    def test_program(canarm_bench):
        program = canarm_bench.start_controller([sys.executable, "program.py", str(canarm_bench.port), "stay"])
        canarm_bench.wait_for(lambda: canarm_bench.heartbeat_state(1), 30)
        assert canarm_bench.heartbeat_state(1) is NmtState.OPERATIONAL
        assert canarm_bench.heartbeat_state(0x55) is None
        assert [(each.command, each.node_id) for each in canarm_bench.nmt_commands] == [(NmtCommand.START, 0x12)]
        assert canarm_bench.outputs_are_zero()
        canarm_bench.wait_for(lambda: "sent" in program.output, 30)
        assert program.status is None
        program.kill()
        assert program.status < 0
    """
    run(text).assert_outcomes(passed=1)


def test_a_wait_that_is_in_vain_ends_and_tells_what_the_controller_said(run) -> None:
    text = """
    import sys
    def test_wait(canarm_bench):
        program = canarm_bench.start_controller([sys.executable, "-c", "print('no bus found'); raise SystemExit(3)"])
        assert program.wait(30) == 3
        canarm_bench.wait_for(lambda: False, 0.2, "a miracle")
    """
    result = run(text)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["E*not within 0.2 s: a miracle; *ended with status 3, said: no bus found*"])
    assert kept(result).exists()


def test_a_question_to_a_bench_that_can_have_no_answer_is_refused(run) -> None:
    text = """
    import pytest
    from canarm.usage import UsageError
    def test_refusals(canarm_bench):
        for timeout in (float("nan"), float("inf"), -1.0):
            with pytest.raises(UsageError, match="^wait_for: timeout .*: must be a number of seconds, at least 0$"):
                canarm_bench.wait_for(lambda: False, timeout)
        for ask in (canarm_bench.true_angle_rad, canarm_bench.true_speed_rad_s):
            with pytest.raises(UsageError, match="^no joint 'joint9'; .* There are joint2, joint3$"):
                ask("joint9")
        for node in (0, 128, "adc"):
            for ask in (canarm_bench.heartbeat_state, canarm_bench.heartbeat_age_s):
                with pytest.raises(UsageError, match="node-IDs are 0x01 to 0x7F; .* 0x14"):
                    ask(node)
    def test_program(tmp_path):
        from canarm.pytest_plugin.program import Program
        program = Program(["true"], tmp_path / "log")
        with pytest.raises(UsageError, match="^wait: timeout nan"):
            program.wait(float("nan"))
        assert program.wait(60) == 0
    """
    run(text).assert_outcomes(passed=2)


def test_a_wait_ends_with_a_controller_that_has_ended_by_itself(run) -> None:
    text = """
    import sys
    import pytest
    def test_wait(canarm_bench):
        canarm_bench.start_controller([sys.executable, "-c", "print('no bus found'); raise SystemExit(3)"])
        canarm_bench.wait_for(lambda: False, 3600, "a miracle")
    def test_after_exit(canarm_bench):
        program = canarm_bench.start_controller([sys.executable, "-c", ""])
        with pytest.raises(AssertionError, match="^not within 3 s: a miracle"):
            canarm_bench.wait_for(lambda: False, 3, "a miracle", after_exit=True)
        canarm_bench.wait_for(lambda: program.status is not None, 60)
    """
    result = run(text)
    result.assert_outcomes(failed=1, passed=1)
    said = "E*the controller has ended with status 3, before: a miracle; *status 3, said: no bus found*"
    result.stdout.fnmatch_lines([said])
    assert "foreign.py" not in result.stdout.str()


def test_a_command_may_be_a_line_in_which_host_and_port_are_replaced(run, pytester) -> None:
    (pytester.path / "my program.py").write_text("import sys; print(sys.argv[1:])")
    text = """
    import sys
    def test_line(canarm_bench):
        for command in (
            f"{sys.executable} 'my program.py' {{host}}:{{port}} --x={{port}}",
            [sys.executable, "my program.py", "{host}:{port}", "--x={port}"],
        ):
            program = canarm_bench.start_controller(command)
            assert program.wait(60) == 0
            assert program.output.strip() == str([f"127.0.0.1:{canarm_bench.port}", f"--x={canarm_bench.port}"])
    """
    run(text).assert_outcomes(passed=1)


def test_a_command_that_cannot_be_started_is_told_in_one_line(run) -> None:
    text = """
    import pytest
    from canarm.usage import UsageError
    def test_command(canarm_bench):
        for command, message in (
            ("python 'dumb.py", "command python 'dumb.py: No closing quotation"),
            ("", "command: is empty; must be a program and its arguments"),
        ):
            with pytest.raises(UsageError, match=f"^{message}$"):
                canarm_bench.start_controller(command)
        canarm_bench.start_controller("no-such-program --port {port}")
    """
    result = run(text)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["E*UsageError: command no-such-program --port *: cannot be started: No such file or directory"]
    )
    assert "program.py" not in result.stdout.str()


def test_faults_that_never_began_are_a_warning(run) -> None:
    text = """
    def test_rig(canarm_rig):
        rig = canarm_rig(law="pd")
        rig.inject("joint2.tachometer", "stuck", at=5)
        rig.inject("joint3.tachometer", "stuck", at=0.01)
        rig.run(seconds=0.1)
    def test_bench(canarm_bench):
        canarm_bench.inject("joint2.latch", "dropout", manual=True, name="mine")
        canarm_bench.inject("joint3.latch", "dropout", name="at once")
    """
    result = run(text)
    result.assert_outcomes(passed=2, warnings=2)
    result.stdout.fnmatch_lines(["*FaultWarning: fault never began: joint2.tachometer stuck"])
    result.stdout.fnmatch_lines(["*FaultWarning: fault never began: mine"])
    run(text, "-W", "error::canarm.pytest_plugin.FaultWarning").assert_outcomes(passed=2, errors=2)


def test_the_report_tells_the_runs_of_a_test_apart(run) -> None:
    text = """
    def test_two(canarm_rig, canarm_bench):
        for law in ("pd", "mras"):
            rig = canarm_rig(law=law)
            rig.inject("joint2.tachometer", "stuck", at=0.01, name=law)
            rig.run(0.1)
        canarm_bench.inject("joint2.latch", "dropout", duration=5)
        assert 0
    """
    result = run(text)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "*- canarm, run 1 of 3: canarm_bench -*",
            "*fault begins: joint2.latch dropout",
            "*- canarm, run 2 of 3: canarm_rig('konkuk1', law='pd') -*",
            "run folder: *test_two*run-2",
            "*fault begins: joint2.tachometer stuck (pd)",
            "*- canarm, run 3 of 3: canarm_rig('konkuk1', law='mras') -*",
        ]
    )


def test_the_report_of_a_typo_shows_the_test_alone(run) -> None:
    text = """
    def test_typo(canarm_rig):
        rig = canarm_rig(law="pd")
        rig.inject("joint2.tacho", "stuck")
    def test_cell(canarm_rig):
        canarm_rig("konkuk9")
    def test_sdo(canarm_bench):
        canarm_bench.inject("joint2.tacho", "stuck")
    """
    result = run(text)
    result.assert_outcomes(failed=3)
    result.stdout.fnmatch_lines(["E*FaultError: *no tap 'joint2.tacho'; did you mean 'joint2.tachometer'*"])
    shown = {line.split(":")[0] for line in result.outlines if re.match(r"\S+\.py:\d+: ", line)}
    assert shown == {"test_the_report_of_a_typo_shows_the_test_alone.py"}


@pytest.mark.slow
def test_no_process_outlives_its_test(run, pytester) -> None:
    text = """
    import sys
    def test_left(canarm_bench):
        program = canarm_bench.start_controller([sys.executable, "-c", "import time; time.sleep(600)"])
        open("pids", "w").write(f"{program._process.pid} {canarm_bench._emulator._process.pid}")
        assert 0
    """
    run(text).assert_outcomes(failed=1)
    for pid in (pytester.path / "pids").read_text().split():
        with pytest.raises(ProcessLookupError):
            os.kill(int(pid), 0)


def test_faults_are_injected_by_sdo_and_refused_with_the_bench_s_reason(run) -> None:
    text = """
    import pytest
    from canarm_protocol.errors import FaultError
    def test_inject(canarm_bench):
        assert canarm_bench.inject("joint2.tachometer", "stuck", manual=True) == "joint2.tachometer stuck"
        with pytest.raises(FaultError, match="fault 'stuk' is not supported at joint2.tachometer"):
            canarm_bench.inject("joint2.tachometer", "stuk")
        canarm_bench.clear()
    """
    run(text).assert_outcomes(passed=1)


# The cookbook


def test_every_recipe_on_the_page_is_a_test_that_runs() -> None:
    page = (ROOT / "docs" / "fault-tests.md").read_text(encoding="utf-8")
    recipes = [
        path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples" / "fault_tests").glob("test_*.py"))
    ]
    blocks = re.findall(r"```python\n(.*?)\n```", page, re.DOTALL)
    first, *others = [part for block in blocks for part in block.split("\n\n\n")]
    assert [part for part in others if not any(part in recipe for recipe in recipes)] == []
    assert all(any(part in recipe for part in others) for recipe in recipes)
    assert "def test_first(canarm_rig)" in first


def test_the_first_test_of_the_page_passes(run) -> None:
    page = (ROOT / "docs" / "fault-tests.md").read_text(encoding="utf-8")
    block = re.search(r"```python\n(.*?)\n```", page, re.DOTALL)
    assert block
    run(block[1]).assert_outcomes(passed=1)


def test_rigs_may_be_shared_by_a_class_or_a_file_and_are_kept_when_one_of_its_tests_fails(run, tmp_path: Path) -> None:
    text = """
    import pytest

    @pytest.fixture(scope="class")
    def rig(class_canarm_rig):
        rig = class_canarm_rig(law="pd")
        rig.run(0.1)
        return rig

    @pytest.fixture(scope="module")
    def other(module_canarm_rig):
        rig = module_canarm_rig(law="pd")
        rig.run(0.1)
        return rig

    class TestRobot:
        def test_fails(self, rig):
            assert rig.joints["joint2"].stays_below("current_a", 0.0)

        def test_asks_the_same_rig(self, rig, other):
            rig.run(0.1)
            assert rig.time_s > 0.15
    """
    result = run(text, f"--canarm-out={tmp_path / 'kept'}")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*the run is shared by all tests of TestRobot; it will be kept below *kept*"])
    (folder,) = (tmp_path / "kept").iterdir()
    assert (folder / "joints.svg").exists()


def test_a_rig_that_a_test_makes_and_never_runs_is_a_warning_of_that_test(pytester):
    pytester.makepyfile(
        """
        from canarm import Rig
        rigs = []

        def test_forgetful():
            rigs.append(Rig())

        def test_thorough(canarm_rig):
            Rig().run(0.1)
            canarm_rig().run(0.1)
        """
    )
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider")  # this process ignores the warning
    result.assert_outcomes(passed=2, warnings=1)
    result.stdout.fnmatch_lines(["*.py::test_forgetful", "*RigWarning: nobody has run this rig: it has tested*"])
