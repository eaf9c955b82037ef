"""The command line as its users meet it: help, wrong input, the environment."""

import os
import shlex
import signal
import subprocess
import sys
from typing import get_args

import pytest
from cyclopts import Token

from canarm import cli
from canarm.options import whole_number

OPTIONS = {
    "demo": "--cell --set --law --feedforward --trajectory --seconds --clock --pace --sync-timeout --seed --truth "
    "--wire --out --no-tui --json",
    "emulator": "--serve --allow-remote --slcan --cell --set --clock --sync-timeout --seed --truth --wire --seconds "
    "--out --json "
    "--interface -i --channel -c --bus-kwargs --bench-interface --bench-channel --bench-bus-kwargs",
    "controller": "--connect --cell --set --law --feedforward --trajectory --clock --pace --sync-timeout --seconds "
    "--out --json "
    "--interface -i --channel -c --bus-kwargs --bench-interface --bench-channel --bench-bus-kwargs",
    "tui": "--connect --cell --set --interface -i --channel -c --bus-kwargs --bench-interface --bench-channel "
    "--bench-bus-kwargs",
    "monitor": "--connect --cell --eds --dbc --bitrate --filter --seconds --no-tui --interface -i --channel -c "
    "--bus-kwargs",
    "check": "--cell --set --keys",
    "jog": "--connect --cell --set --clock --do --interface -i --channel -c --bus-kwargs",
    "export": "--cell --set --bus --out",
}


class InProcess:
    """`canarm …` without a process: many wrong command lines in little time."""

    def __init__(self, capsys) -> None:
        self._capsys = capsys

    def __call__(self, arguments: list[str]) -> int:
        return cli.run(arguments)

    def printed(self) -> tuple[str, str]:
        """What went to stdout and to stderr."""
        return tuple(self._capsys.readouterr())


@pytest.fixture
def in_process(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    handlers = [signal.getsignal(number) for number in numbers]
    yield InProcess(capsys)
    for number, handler in zip(numbers, handlers, strict=True):
        signal.signal(number, handler)


def words_of(process) -> list[str]:
    """The words on stdout, the frames around them left out."""
    return " ".join(process.stdout).replace("│", " ").split()


def test_help_lists_the_commands_that_there_are(canarm):
    process = canarm("--help")
    assert process.wait() == 0
    words = words_of(process)
    assert set(OPTIONS) | {"replay", "report", "runs", "study", "identify"} <= set(words)
    assert "tune" not in words
    assert "--install-completion" in words


@pytest.mark.parametrize("command", OPTIONS)
def test_help_of_a_command_shows_its_options_with_defaults_and_units(canarm, command):
    process = canarm(command, "--help")
    assert process.wait() == 0
    words = words_of(process)
    assert set(OPTIONS[command].split()) <= set(words)
    text = " ".join(words)
    assert "[default: konkuk1]" in text
    assert "--with-parent" not in words
    assert "[default: []]" not in text
    assert "[default: False]" not in text
    if "--seconds" in words:
        assert "--seconds SECONDS" in text
    if command == "demo":
        assert "[default: 10.24 s]" in text
    assert process.complaint == ""


def test_version_is_the_distributions(canarm):
    process = canarm("--version")
    assert process.wait() == 0
    assert process.stdout == [cli.version()]


@pytest.mark.parametrize(
    ("command", "needed"),
    [("controller", "canarm_controller"), ("emulator", "canarm_emulator mujoco"), ("demo", "canarm_controller")],
)
def test_a_command_starts_without_what_it_does_not_run(command, needed, canarm):
    dear = {"canarm.runs.run", "canarm_controller", "canarm_emulator", "canarm_tui", "mujoco"}
    program = f"import canarm.commands.{command}, sys; print(*sorted({dear} & {{*sys.modules}}))"
    process = canarm.run(sys.executable, "-c", program)
    assert process.wait() == 0
    assert process.stdout == [needed]


@pytest.mark.parametrize(
    ("arguments", "what", "right"),
    [
        ("emulate", 'Unknown command "emulate"', "emulator"),
        ("emulator --sed 1", "Unknown option: --sed", "--seed"),
        ("controller --clock sink", "--clock", '"sync"'),
        ("controller --seconds soon", '"soon"', "float"),
        ("controller --seconds -1", "--seconds", "above 0"),
        ("controller --seconds 0.001", "--seconds 0.001", "0.0025 s"),
        ("demo --seconds nan", "--seconds", "above 0"),
        ("demo --seconds 1e300", "--seconds", "at most 1e+09 s"),
        ("demo --seed -1", "--seed", "0 or more"),
        ("demo --law pid", "law 'pid'", "mras"),
        ("demo --law missing.py:Law", "missing.py", "existing"),
        ("demo --trajectory circle", "circle", "sine"),
        ("demo --feedforward tabel", "tabel", '"table"'),
        ("demo --truth joint3.weight=1", "joint3.weight", "joint3."),
        ("demo --truth joint3.mass=heavy", "joint3.mass", "number"),
        ("emulator --truth joint3.mass", "--truth joint3.mass", "KEY=VALUE"),
        ("controller --set control.mras.gama_bias=1", "gama_bias", "gamma_bias"),
        ("controller --set gain=1", "gain=1", "control."),
        ("controller --set control.damping_ratio=-1", "control.damping_ratio", "greater than 0"),
        ("emulator --serve 29536", "--serve 29536", "HOST:PORT"),
        ("emulator --serve 127.0.0.1:port", "--serve 127.0.0.1:port", "HOST:PORT"),
        ("emulator --serve 127.0.0.1:70000", "70000", "65535"),
        ("emulator --serve 127.0.0.1:" + "9" * 5000, "127.0.0.1:9999", "65535"),
        ("controller -i canarm port=" + "9" * 5000, "port", "5000 digits"),
        ("emulator --serve 0.0.0.0:0", "0.0.0.0:0", "--allow-remote"),
        ("emulator --serve nowhere.invalid:0", "nowhere.invalid", "127.0.0.1"),
        ("emulator --sync-timeout 0", "--sync-timeout", "above 0"),
        ("demo --sync-timeout soon", "--sync-timeout", "or none"),
        ("demo --seed 1.5", "--seed", "must be a whole number"),
        ("demo --seed 9223372036854775808", "--seed", "at most 9223372036854775807"),
        ("controller --spin 1.5", "--spin", "must be a whole number"),
        ("demo --pace 0", "--pace", "0.01 or more, or max"),
        ("demo --clock wall --pace 1", "--pace 1", "the wall clock has one pace"),
        ("controller --pace inf", "--pace", "or max"),
        ("emulator -i udp_multicast --clock sync", "udp_multicast", "--clock wall"),
        ("controller --bench-interface udp_multicast -i udp_multicast --clock sync", "udp_multicast", "--clock wall"),
        ("controller --connect localhost", "--connect localhost", "HOST:PORT"),
        ("controller --connect 127.0.0.1:0", "127.0.0.1:0", "from 1 to"),
        ("controller -i sockecan", "-i sockecan", "socketcan"),
        ("controller --bench-interface zzz", "zzz", "virtual"),
        ("controller -c vcan0", "vcan0", "-i"),
        ("controller bitrate=500000", "bitrate=500000", "-i"),
        ("controller -i virtual bitrate", "'bitrate'", "KEY=VALUE"),
        ("controller -i virtual interface=canarm", "interface=canarm", "-i canarm"),
        ("tui --bench-channel bench", "bench", "--bench-interface"),
        ("check --cell konkuk2", "konkuk2", "konkuk1"),
    ],
)
def test_a_wrong_command_line_is_one_line_and_status_2(in_process, arguments, what, right):
    assert in_process(arguments.split()) == 2
    printed, complaint = in_process.printed()
    assert printed == ""
    assert complaint.startswith("canarm: ")
    assert len(complaint.splitlines()) == 1
    assert what in complaint
    assert right in complaint


@pytest.mark.parametrize(
    "arguments",
    [
        "emulate",
        "emulator --sed 1",
        "demo --law pid",
        "demo --trajectory circle",
        "demo --truth joint3.weight=1",
        "controller --set control.mras.gama_bias=1",
        "controller -i sockecan",
        "emulator --serve 29536",
    ],
)
def test_it_is_so_in_a_process_too(canarm, arguments):
    process = canarm(*arguments.split())
    assert process.wait() == 2
    assert process.stdout == []
    assert len(process.stderr) == 1
    assert process.complaint.startswith("canarm: ")


@pytest.mark.parametrize(
    ("replaced", "by", "what", "right"),
    [
        ('title = "KON', "title = KON", "not valid TOML", "line 5"),
        ("cycle_us = 2500", "cycle_ms = 3", "bus.cycle_ms", "did you mean 'cycle_us'"),
        ("bitrate = 1_000_000", "bitrate = 123", "bus.bitrate = 123", "1000000"),
        ("heartbeat_timeout_ms = 100", "heartbeat_timeout_ms = 30", "heartbeat_timeout_ms", "at least twice"),
        ("mass_kg = 0.6", "mass_kg = -0.6", "mass_kg = -0.6", "greater than 0"),
        ("node_id = 0x14", "node_id = 0x13", "node_id = 0x13", "'latch' has it already"),
        ('signal = "joint3.direction"', 'signal = "joint4.direction"', "joint4", "joint3"),
    ],
)
def test_a_wrong_cell_file_is_said_where_and_what_and_status_2(canarm, replaced, by, what, right):
    canarm.write_cell("cell.toml", {replaced: by})
    process = canarm("check", "--cell", "cell.toml")
    assert process.wait() == 2
    assert process.stderr
    assert all(line.startswith("canarm: cell.toml: ") for line in process.stderr)
    assert what in process.complaint
    assert right in process.complaint


@pytest.mark.parametrize("command", ["demo", "emulator", "controller", "tui"])
def test_every_command_refuses_a_wrong_cell_file_before_anything_else(canarm, command):
    canarm.write_cell("cell.toml", {"cycle_us = 2500": "cycle_us = 0"})
    process = canarm(command, "--cell", "cell.toml")
    assert process.wait() == 2
    assert process.complaint.startswith("canarm: cell.toml: bus.cycle_us = 0")


def test_a_folder_is_no_cell_file(canarm):
    (canarm.folder / "cell").mkdir()
    process = canarm("check", "--cell", "cell")
    assert process.wait() == 2
    assert process.complaint == "canarm: cell: is no regular file; a cell is a TOML file"


def test_check_shows_what_the_cell_describes_and_that_it_is_right(canarm):
    process = canarm("check")
    assert process.wait() == 0
    assert process.stdout[-1] == "ok"
    assert any("RPDO2 0x312" in line and "joint3.current_command" in line for line in process.stdout)


def test_check_lists_keys_with_unit_and_nominal_value(canarm):
    process = canarm("check", "--keys", "--set", "control.damping_ratio=0.7")
    assert process.wait() == 0
    rows = [line.split() for line in process.stdout]
    assert ["joint3.mass", "0.6", "kg"] in [row[:3] for row in rows]
    assert ["control.damping_ratio", "0.7"] in rows


def test_an_option_can_come_from_the_environment_and_the_command_line_wins(canarm):
    from_environment = canarm("check", "--keys", env={"CANARM_SET": "control.damping_ratio=0.7"})
    overridden = canarm(
        "check", "--keys", "--set", "control.damping_ratio=0.8", env={"CANARM_SET": "control.damping_ratio=0.7"}
    )
    assert (from_environment.wait(), overridden.wait()) == (0, 0)
    assert any(line.split() == ["control.damping_ratio", "0.7"] for line in from_environment.stdout)
    assert any(line.split() == ["control.damping_ratio", "0.8"] for line in overridden.stdout)


def test_a_wrong_value_in_the_environment_is_named_as_such(canarm):
    process = canarm("emulator", env={"CANARM_CLOCK": "sink"})
    assert process.wait() == 2
    assert "CANARM_CLOCK" in process.complaint
    wrong_level = canarm("check", env={"CANARM_LOG": "loud"})
    assert wrong_level.wait() == 2
    assert "CANARM_LOG=loud: must be debug" in wrong_level.complaint


def test_completion_can_be_installed(canarm):
    process = canarm("--install-completion", "--shell", "bash", "--output", "canarm.sh")
    assert process.wait() == 0
    assert "emulator" in (canarm.folder / "canarm.sh").read_text()


def test_without_a_terminal_the_dashboard_says_what_it_needs(canarm):
    process = canarm("tui")
    assert process.wait() == 2
    assert "terminal" in process.complaint


def test_a_reader_that_has_gone_is_status_1_and_no_word(canarm):
    reading, writing = os.pipe()
    os.close(reading)
    try:
        process = subprocess.run(
            [sys.executable, "-m", "canarm", "check", "--keys"],
            stdout=writing,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60.0,
            check=False,
        )
    finally:
        os.close(writing)
    assert process.returncode == 1
    assert process.stderr == ""


@pytest.mark.parametrize(
    ("command", "meant"),
    [
        ("check my.toml", "--cell my.toml"),
        ("check konkuk1-brakes", "--cell konkuk1-brakes"),
        ("fault list my.toml", "--cell my.toml"),
        ("export eds my.toml", "--cell my.toml"),
        ("demo my.toml", "--cell my.toml"),
        ("demo broken.toml", "--faults broken.toml"),
        ("demo move.csv:samples", "--trajectory move.csv:samples"),
        ("demo laws.py:Mine", "--law laws.py:Mine"),
        ("emulator my.toml", "--cell my.toml"),
        ("controller laws.py:Mine", "--law laws.py:Mine"),
        ("new-cell arm.urdf", "--urdf arm.urdf"),
    ],
)
def test_a_file_without_its_option_is_told_the_option(tmp_path, monkeypatch, capsys, command, meant):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.toml").write_text('[[set]]\n[[set.fault]]\ntap = "joint2.motor"\nfault = "open-load"\n')
    assert cli.run(command.split()) == 2
    assert f"Did you mean {meant}?" in capsys.readouterr().err


def test_a_word_that_is_nothing_gets_no_hint(capsys):
    assert cli.run(["check", "nonsense"]) == 2
    assert "Did you mean" not in capsys.readouterr().err


ENDLESS = ["x" * 5000, "9" * 5000, "a b " * 1500]


@pytest.mark.parametrize("endless", ENDLESS, ids=["word", "digits", "prose"])
@pytest.mark.parametrize(
    "command",
    [
        "{}",
        "fault {}",
        "check {}",
        "check --cell {}",
        "check --{}",
        "check --set {}",
        "check --set control.{}=1",
        "demo --law {}",
        "demo --law mine.py:{}",
        "demo --clock {}",
        "demo --seconds {}x",
        "demo --truth {}",
        "demo --truth joint3.mass={}",
        "demo --faults mine.toml",
        "demo --trajectory mine.csv",
        "emulator --serve {}",
        "emulator --serve 127.0.0.1:{}",
        "emulator -i {}",
        "emulator -i virtual --bus-kwargs {}",
        "fault matrix --only {}",
        "fault inject joint2.tachometer stuck {}",
    ],
)
def test_a_foreign_text_is_shown_shortened_wherever_it_came_from(tmp_path, monkeypatch, capsys, command, endless):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.csv").write_text(f"time_s,{endless}\n0,1\n")
    (tmp_path / "mine.toml").write_text(f"""[[set]]\nwhen = '{endless}'\n[[set.fault]]\ntap = "x"\nfault = "y"\n""")
    assert cli.run([word.replace("{}", endless) for word in command.split()]) == 2
    complaint = capsys.readouterr().err
    assert "should not happen" not in complaint
    assert len(complaint) < 800
    assert max(map(len, complaint.split())) < 260  # 200 characters, and what stands around them


def test_a_reader_of_the_first_line_does_not_end_the_emulator(canarm):
    command = f"{shlex.quote(sys.executable)} -m canarm emulator --serve 127.0.0.1:0 --seconds 1 | head -1"
    process = canarm.run("sh", "-c", command)
    assert process.wait() == 0
    assert [line.split()[0] for line in process.stdout] == ["can0"]
    assert process.complaint == ""


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ZeroDivisionError("division by zero"), "this should not happen: ZeroDivisionError: division by zero"),
        (OSError(28, "No space left on device", "x.log"), "x.log: No space left on device"),
        (KeyboardInterrupt(), "interrupted"),
    ],
)
def test_what_nobody_foresaw_is_a_line_and_status_1(monkeypatch, in_process, error, said):
    def fail(*arguments, **options):
        raise error

    monkeypatch.setattr(cli, "app", fail)
    assert in_process([]) == 1
    _, complaint = in_process.printed()
    assert complaint.startswith(f"canarm: {said}")
    assert len(complaint.splitlines()) == 1


def test_an_option_without_a_value_is_no_current_folder(tmp_path, monkeypatch, capsys):
    """A script's `--out "$OUT"` with OUT unset."""
    monkeypatch.chdir(tmp_path)
    for words in (["--out", ""], ["--out="]):
        assert cli.run(["emulator", *words]) == 2
        assert "--out: its value is empty; name a folder, or leave --out out" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_an_empty_variable_counts_as_none(monkeypatch, capsys):
    monkeypatch.setenv("CANARM_CELL", "")
    assert cli.run(["check", "--keys"]) == 0
    assert "joint2" in capsys.readouterr().out


def test_every_whole_number_refuses_a_fraction():
    """The parser alone would round 1.5 seeds to 2."""
    found = []

    def look(known, words):
        for argument in known.assemble_argument_collection() if known.default_command else ():
            if argument.hint is int or int in get_args(argument.hint):
                found.append((*words, argument.name))
                assert argument.parameter.converter is whole_number, (words, argument.name)
        for name in known:
            if not name.startswith("-"):
                look(known[name], (*words, name))

    look(cli.app, ())
    assert {("fault", "matrix", "--seeds"), ("new-cell", "--bits"), ("fault", "inject", "--cycle")} <= set(found)
    with pytest.raises(ValueError, match="must be a whole number"):
        whole_number(int, [Token(value="1.5")])
