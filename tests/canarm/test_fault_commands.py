"""Faults from the command line and over the bench bus: several clients at once, and the same bytes again."""

import json
import os
import re
from pathlib import Path

import pytest

from canarm import BenchClient, Rig, open_run
from canarm.cli import run
from canarm.fault_text import parse_parameters, status_lines
from canarm.rig.arguments import RigWarning
from canarm_emulator.faults.declaration import declared_faults
from canarm_protocol.cell import bench_objects as objects
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.errors import BusError, FaultError
from canarm_protocol.faults.script import parse_faults
from canarm_protocol.transport.port import open_port
from canarm_protocol.transport.sdo_session import SdoSession

CELL = load_cell("konkuk1")
PAGE = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")
SECONDS = "1.5"
FAULTS = """
[[set]]
name = "noise"
cycle = 80
duration = 0.1
repeat = 2
period = 0.2
[[set.fault]]
tap = "joint2.tachometer"
fault = "noise"
deviation = 0.1

[[set]]
name = "heavier"
when = "time_s > 0.8"
[[set.fault]]
tap = "joint3.link"
fault = "payload-change"
"""
HAMMER = """
import sys
from canarm import BenchClient
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.errors import FaultError
from canarm_protocol.transport.port import open_port

port, name = int(sys.argv[1]), sys.argv[2]
SET = '''[[set]]
name = "{0}"
manual = true
[[set.fault]]
tap = "joint2.tachometer"
fault = "stuck"
#''' + 3000 * "x"
with open_port("canarm", "bench", host="127.0.0.1", port=port) as bus, BenchClient(bus, load_cell("konkuk1")) as client:
    print("channel", client.channel, flush=True)
    sys.stdin.readline()
    for number in range(20):
        mine = f"{name} {number}"
        assert client.inject(SET.format(mine)) == f"accepted {mine!r}"
        assert mine in [each["set"] for each in client.status()["sets"]]
        try:
            client.inject(SET.format(mine))
        except FaultError as error:
            assert repr(mine) in str(error), error
        else:
            raise AssertionError("taken twice")
        assert client.clear(mine) == "cleared 1"
    print("done", flush=True)
"""


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def emulator(canarm):
    return canarm.emulator("sync")


@pytest.fixture
def bench_port(emulator):
    with open_port("canarm", "bench", host="127.0.0.1", port=emulator.port) as port:
        yield port


# canarm fault list


def test_list_shows_taps_with_their_faults_and_parameters(capsys):
    assert run(["fault", "list", "--tap", "joint2.tachometer"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[0].startswith("joint2.tachometer [V]: ")
    assert "stuck The signal stays at one value." in lines
    assert any(line.startswith("value (0 to 5 V): ") for line in lines)
    assert any(line.startswith("ratio 0.8 (0 to 1): ") for line in lines)


def test_list_as_json_is_what_the_bench_itself_says(capsys, bench_port):
    assert run(["fault", "list", "--json"]) == 0
    with BenchClient(bench_port, CELL) as client:
        assert client.catalogue() == json.loads(capsys.readouterr().out)


def test_list_shows_identifiers_as_one_writes_them(capsys):
    assert run(["fault", "list", "--tap", "can0.*"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    identifiers = {line.partition(": ")[0] for line in lines if line.startswith("cob_id ")}
    assert {"cob_id 0 (0x0 to 0x7FF)", "cob_id 0x294 (0x1 to 0x7FF)"} <= identifiers


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("cob_id=0x294", 0x294),
        ("cob_id=0X294", 0x294),
        ("cob_id=660", 660),
        ("value=1e-3", 1e-3),
        ("value=-010", -10),
        ("state=0xyz", "0xyz"),
        ("on=true", True),
        ("value=\u0661", "\u0661"),
        ("cob_id=1_0", "1_0"),
        ("cob_id=0x1_0", "0x1_0"),
        ("value=0x" + "f" * 5000, "0x" + "f" * 5000),
    ],
)
def test_values_have_the_type_that_they_look_like(word, value):
    (found,) = parse_parameters([word]).values()
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    ("pattern", "complaint"),
    [
        ("joint2.tacho", "--tap joint2.tacho: no such tap; did you mean 'joint2.tachometer'?"),
        ("joint9.*", "--tap joint9.*: no such tap; did you mean 'joint3.*'?"),
        ("zzz*", "--tap zzz*: no such tap; names begin with joint2, joint3, adc, can0, node, bench"),
        ("joint2.z*", "--tap joint2.z*: no such tap; names begin with joint2, joint3, adc, can0, node, bench"),
    ],
)
def test_a_tap_that_there_is_not_is_told_in_a_line_with_what_was_meant(pattern, complaint, capsys):
    assert run(["fault", "list", "--tap", pattern]) == 2
    assert capsys.readouterr().err.strip() == f"canarm: {complaint}"


@pytest.mark.parametrize(("count", "words"), [(0, "has not begun"), (1, "has begun once"), (2, "has begun 2 times")])
def test_status_says_how_often_a_set_has_begun_and_whether_a_run_is_on(count, words):
    one = {"set": "a", "state": "waiting", "activations": count}
    status = {"running": True, "cycle": 7, "active": [], "begun": count, "sets": [one], "detections": []}
    first, second = status_lines(status)
    assert first.startswith("a run is on, cycle 7; ")
    assert second == f"  set 'a': waiting, {words}"


def test_list_takes_patterns_and_refuses_taps_that_there_are_not(capsys):
    assert run(["fault", "list", "--tap", "node.*", "--json"]) == 0
    assert [each["tap"] for each in json.loads(capsys.readouterr().out)] == ["node.0x12", "node.0x13", "node.0x14"]
    assert run(["fault", "list", "--tap", "joint2.tacho"]) == 2
    assert "joint2.tachometer" in capsys.readouterr().err


# On a running bench


def test_a_fault_is_injected_triggered_shown_and_cleared(canarm, emulator, capsys):
    at = ["--connect", f"127.0.0.1:{emulator.port}"]

    def fault(*arguments):
        status = run(["fault", *arguments, *at])
        said = capsys.readouterr()
        return status, said.out.strip(), said.err.strip()

    assert fault("inject", "joint2.tachometer", "stuck", "value=2.5", "--manual") == (
        0,
        "accepted 'joint2.tachometer stuck'",
        "",
    )
    assert fault("inject", "joint2.tachometer", "stuck")[1] == "accepted 'joint2.tachometer stuck #2'"
    assert fault("trigger", "joint2.tachometer stuck")[1] == "triggered 'joint2.tachometer stuck'"
    status, text, _ = fault("status", "--json")
    assert status == 0
    active = [(each["set"], each["tap"], each["fault"]) for each in json.loads(text)["active"]]
    assert active == [(f"joint2.tachometer stuck{which}", "joint2.tachometer", "stuck") for which in (" #2", "")]
    assert "set 'joint2.tachometer stuck #2': active, has begun once" in fault("status")[1]
    assert fault("status")[1].startswith("no run is on: at and cycle count from the next NMT start; 2 faults act")
    assert fault("clear", "joint2.tachometer stuck #2")[1] == "cleared 1"
    emulator.wait_for(r"fault begins: joint2.tachometer stuck \(joint2.tachometer stuck #2\), before the first cycle")
    emulator.wait_for(r"fault ends: joint2.tachometer stuck")

    status, _, complaint = fault("inject", "joint2.tachometer", "stuck", "value=7")
    assert status == 2
    assert "value = 7: must be a number from 0 to 5 V" in complaint
    (canarm.folder / "f.toml").write_text(FAULTS)
    assert fault("inject", "--file", str(canarm.folder / "f.toml"))[1] == (
        "accepted 'noise', 'heavier'; no run is on: cycle counts from the next NMT start"
    )
    assert fault("clear")[1] == "cleared 3"
    assert fault("clear", "nobody")[0] == 2


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["joint2.tachometer"], "name TAP and FAULT, or a --file"),
        (["joint2.tachometer", "stuck", "value"], "value: write KEY=VALUE"),
        (["joint2.tachometer", "stuck", "value=1", "value=2"], "value=2: value is given twice"),
        (["joint2.tachometer", "stuck", "--file", "f.toml"], "leave tap and fault out"),
        (["--file", "f.toml", "--manual"], "leave --manual out"),
    ],
)
def test_a_wrong_command_line_is_told_before_any_bench_is_looked_for(arguments, complaint, capsys):
    assert run(["fault", "inject", *arguments, "--connect", "127.0.0.1:1"]) == 2
    assert complaint in capsys.readouterr().err


@pytest.mark.parametrize("words", ["emulator --faults=", "demo --faults=", "fault inject --file="])
def test_an_empty_name_of_a_file_is_told(words, capsys):
    assert run(words.split()) == 2
    assert "the name of the file is empty" in capsys.readouterr().err


def test_a_name_that_is_no_text_is_told(emulator, bench_port, capsys):
    assert run(["fault", "clear", "\udcff", "--connect", f"127.0.0.1:{emulator.port}"]) == 2
    assert capsys.readouterr().err == "canarm: fault set: '\\udcff' is no text, and cannot be sent\n"
    with BenchClient(bench_port, CELL) as client, pytest.raises(FaultError, match="is no text"):
        client.inject('clear = "\ud800"')


@pytest.mark.slow
def test_two_processes_at_once_each_have_a_channel_and_do_not_disturb_each_other(canarm, emulator):
    processes, pipes = [], []
    for name in ("one", "two"):
        reading, writing = os.pipe()
        processes.append(canarm.python("-c", HAMMER, str(emulator.port), name, stdin=reading))
        os.close(reading)
        pipes.append(writing)
    channels = [process.wait_for(r"channel (\d)")[1] for process in processes]
    assert len(set(channels)) == 2, channels
    for pipe in pipes:
        os.close(pipe)
    for process in processes:
        assert process.wait() == 0, process
        assert process.stdout[-1] == "done"


def test_clients_get_different_channels_until_there_are_no_more(bench_port):
    clients = [BenchClient(bench_port, CELL) for _ in objects.CLIENT_CHANNELS]
    assert sorted(client.channel for client in clients) == list(objects.CLIENT_CHANNELS)
    with pytest.raises(BusError, match=r"bench node 0x70 on .* all 7 channels for clients are taken"):
        BenchClient(bench_port, CELL)
    clients[3].close()
    with BenchClient(bench_port, CELL) as another:
        assert another.channel not in {client.channel for client in clients if client is not clients[3]}


def test_a_client_that_has_gone_without_a_word_leaves_its_channel(emulator, until):
    def attach():
        return open_port("canarm", "bench", host="127.0.0.1", port=emulator.port)

    lost = attach()
    channel = BenchClient(lost, CELL).channel
    lost.close()
    with attach() as port:
        answers = SdoSession(port, *objects.sdo_channel(0x70, 0), limit_s=20.0)
        until(lambda: answers.upload(objects.CHANNEL_OWNER, channel) == bytes(4), "channel is free")


def test_a_client_claims_its_channel_anew_after_a_silence(bench_port):
    with BenchClient(bench_port, CELL) as client:
        client._used_s -= objects.CLAIM_S
        assert client.status()["begun"] == 0
        with BenchClient(bench_port, CELL) as other:
            assert other.channel != client.channel


def test_the_client_does_all_that_the_bench_offers(bench_port):
    with BenchClient(bench_port, CELL, limit_s=20.0) as client:
        assert client.events() == []
        client.inject('[[set]]\nname = "x"\n[[set.fault]]\ntap = "joint2.latch"\nfault = "reversed-direction"')
        assert [each["event"] for each in client.events()] == ["fault-begins"]
        assert not client.is_stopped
        client.emergency_stop()
        assert client.is_stopped
        client.emergency_stop(False)
        assert not client.is_stopped
        with pytest.raises(FaultError, match="no set 'y' to trigger"):
            client.trigger("y")
        with pytest.raises(FaultError, match="must have at most 100000"):
            client.inject(100_001 * "#")
    with pytest.raises(BusError, match="bench node 0x70: this client is closed"):
        client.status()


def test_the_emergency_stop_is_told_and_recorded(canarm, run_folder):
    emulator = canarm.emulator("sync", "--out", "run")
    with (
        open_port("canarm", "bench", host="127.0.0.1", port=emulator.port) as port,
        BenchClient(port, CELL, limit_s=20.0) as client,
    ):
        client.emergency_stop()
        emulator.wait_for("emergency stop: the supply of all amplifiers is open")
        client.emergency_stop(False)
        emulator.wait_for("emergency stop: the supply of all amplifiers is closed again")
    stops = [each for each in run_folder(canarm.folder / "run").events() if each["event"] == "emergency-stop"]
    assert [(each["state"], each["cycle"]) for each in stops] == [("on", -1), ("off", -1)]


def test_a_bus_without_a_bench_is_told_with_the_node_that_was_asked(emulator):
    with (
        open_port("canarm", "can0", host="127.0.0.1", port=emulator.port) as port,
        pytest.raises(BusError, match=r"^bench node 0x70 on .*-i canarm .* has not answered within 0.2 s"),
    ):
        BenchClient(port, CELL, limit_s=0.2)


# With a run


@pytest.mark.parametrize("command", ["demo", "emulator"])
@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (
            'fault = "noise"',
            'fault = "nois"',
            "f.toml: set 'noise', fault 1: fault 'nois' is not supported at joint2.ta",
        ),
        ("deviation = 0.1", "deviation = 9", "f.toml: set 'noise', fault 1: noise at joint2.tachometer: deviation = 9"),
        ("time_s > 0.8", "time > 0.8", "f.toml: set 'heavier': "),
        ("repeat = 2", "repeat = 0", "f.toml: set 1 ('noise'): repeat = 0: must be a whole number, at least 1"),
        (FAULTS, 'clear = ""', "f.toml: injects nothing; a fault file for a new run has at least one [[set]]"),
        (FAULTS, "[[set]]", "f.toml: injects nothing; a fault file for a new run has at least one [[set]]"),
    ],
)
def test_a_wrong_fault_file_is_told_before_anything_starts(canarm, command, old, new, complaint, capsys, monkeypatch):
    monkeypatch.chdir(canarm.folder)
    Path("f.toml").write_text(FAULTS.replace(old, new))
    assert run([command, "--clock", "sync", "--faults", "f.toml", "--out", "run"]) == 2
    said = capsys.readouterr()
    assert complaint in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert not Path("run").exists()


def test_a_demo_names_sets_that_have_never_begun(canarm):
    (canarm.folder / "f.toml").write_text(FAULTS.replace("time_s > 0.8", "time_s > 50"))
    demo = canarm("demo", "--clock", "sync", "--no-tui", "--seconds", "1", "--faults", "f.toml", "--out", "run")
    assert demo.wait() == 0, demo
    assert [line for line in demo.stderr if "never began" in line] == ["canarm: fault never began: heavier"]


def test_a_run_that_an_operator_has_stopped_says_so_in_its_summary(canarm):
    demo = canarm("demo", "--no-tui", "--json", "--seconds", "3600", "--pace", "1", "--seed", "3", "--out", "run")
    port = int(demo.wait_for(r"to attach to bench: .* port=(\d+)")[1])
    with (
        open_port("canarm", "bench", host="127.0.0.1", port=port) as bus,
        BenchClient(bus, CELL, limit_s=20.0) as client,
    ):
        demo.wait_for("1 of 3600 s")
        client.emergency_stop()
        assert demo.wait() == 1, demo
    (pressed,) = [each for each in open_run(canarm.folder / "run").event_list if each["event"] == "emergency-stop"]
    said = f"after the emergency stop at {pressed['cycle'] * CELL.bus.cycle_s:.3f} s: "
    assert (demo.json["state"], demo.json["seed"]) == ("failed", 3)
    assert demo.json["reason"].startswith(said)
    assert open_run(canarm.folder / "run").reason == demo.json["reason"]


def test_a_fault_that_needs_the_wire_is_refused_without_it(canarm, capsys):
    path = canarm.folder / "f.toml"
    path.write_text('[[set]]\n[[set.fault]]\ntap = "can0.wire"\nfault = "error-frames"\n')
    assert run(["emulator", "--faults", str(path)]) == 2
    assert "start the emulator with --wire" in capsys.readouterr().err


def test_processes_and_a_rig_with_the_same_fault_file_write_the_same_bytes(canarm):
    (canarm.folder / "f.toml").write_text(FAULTS)
    options = ["--clock", "sync", "--no-tui", "--json", "--seconds", SECONDS, "--seed", "7", "--faults", "f.toml"]
    demo = canarm("demo", *options, "--out", "processes")
    assert demo.wait() in (0, 1), demo
    assert demo.json["faults"] == 3
    assert all(set(each) == {"detector", "where", "tick", "reaction"} for each in demo.json["detections"])
    begins = r"fault begins: joint2.tachometer noise \(noise\), cycle (80|160), "
    assert len([line for line in demo.stderr if re.search(begins, line)]) == 2
    with Rig("konkuk1", seed=7, faults=canarm.folder / "f.toml", out=canarm.folder / "rig") as rig:
        rig.run(float(SECONDS))
    logs = [(canarm.folder / name / "can0.log").read_bytes() for name in ("processes", "rig")]
    assert logs[0] == logs[1]


def test_a_fault_changes_the_bytes(tmp_path):
    for name, faults in (("with", parse_faults(FAULTS)), ("without", None)):
        with Rig("konkuk1", faults=faults, out=tmp_path / name) as rig:
            rig.run(0.5)
    logs = [(tmp_path / name / "can0.log").read_bytes() for name in ("with", "without")]
    assert logs[0] != logs[1]
    assert logs[0][:5000] == logs[1][:5000]


# The page


def test_the_page_names_every_fault():
    words = set(re.findall(r"[a-z0-9]+(?:-[a-z0-9]+)*", PAGE))
    assert {name for name, _ in declared_faults()} <= words


@pytest.mark.parametrize("text", blocks("toml"))
def test_every_fault_file_of_the_page_is_accepted(text, tmp_path):
    with pytest.warns(RigWarning, match="has never run"), Rig("konkuk1") as rig:
        rig._bench.inject(parse_faults(text))


def test_the_snippet_for_python_canopen_injects_by_its_stock_client(canarm, emulator):
    assert run(["export", "eds", "--out", str(canarm.folder / "eds")]) == 0
    snippet = next(block for block in blocks("python") if "import canopen" in block)
    program = canarm.python("-c", snippet.replace("29536", str(emulator.port)))
    assert program.wait() == 0, program
    assert program.stdout[0] == "accepted 'dies'"
    assert json.loads(program.stdout[1])["active"] == [{"set": "dies", "tap": "joint2.tachometer", "fault": "stuck"}]


def test_the_snippet_for_the_client_does_what_it_says(canarm, emulator):
    snippet = next(block for block in blocks("python") if "BenchClient" in block)
    program = canarm.python("-c", snippet.replace("29536", str(emulator.port)))
    assert program.wait() == 0, program
    assert program.stdout[0] == "accepted 'x'"


def test_the_fault_of_the_page_works_and_so_does_its_test(canarm):
    fault, its_test = (block for block in blocks("python") if "dead-band" in block)
    (canarm.folder / "dead_band.py").write_text(fault)
    name = re.search(r"def (test_\w+)", its_test)
    assert name is not None
    program = canarm.python("-c", f"{its_test}\n{name[1]}()\nprint('passed')")
    assert program.wait() == 0, program
    assert program.stdout == ["passed"]
