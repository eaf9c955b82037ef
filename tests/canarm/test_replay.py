"""Recorded runs once more: sent to a bus, driving an emulator, or repeated in lockstep and compared byte for byte."""

import json
import math
import shutil
import signal
from pathlib import Path

import can
import numpy as np
import pytest

from canarm import Rig
from canarm.cli import run as canarm_here
from canarm.runs.replaying import replay_timed
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.runs.can_log import log_frames

LAW = """
import pathlib
from canarm_controller.laws.pd import Pd
pathlib.Path(__file__).with_name("executed").touch()

class Mine(Pd):
    name = "mine"
"""


@pytest.fixture(scope="module")
def eventful(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with faults that were declared and injected on the way, and with a truth that changed."""
    folder = tmp_path_factory.mktemp("replayed") / "run"
    with Rig(law="mras", seed=5, truth={"joint3.mass": 0.9}, out=folder) as rig:
        rig.inject("can0.tx", "lost", at=0.4, duration=0.005)
        rig.run(0.5)
        rig.change_truth("joint3.mass", 0.7)
        rig.run(0.3)
        rig.inject("joint2.tachometer", "stuck", duration=0.2)
        rig.run(0.4)
    return folder


@pytest.fixture
def copy(eventful: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(eventful, tmp_path / "run"))


def change_record(folder: Path, section: str, **changes: object) -> None:
    document = json.loads((folder / "run.json").read_text())
    document[section] |= changes
    (folder / "run.json").write_text(json.dumps(document))


def test_a_run_with_all_that_was_done_to_it_is_the_same_again(
    eventful: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert canarm_here(["replay", str(eventful), "--check"]) == 0
    frames = (eventful / "can0.log").read_bytes().count(b"\n")
    assert capsys.readouterr().out == f"the same: every byte of can0 ({frames} frames)\n"


def test_the_cards_alone_are_driven_again_by_what_a_master_sent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without the controller's files, its frames are those of any other master."""
    folder = tmp_path / "plain"
    with Rig(law="pd", out=folder) as rig:
        rig.inject("joint2.tachometer", "stuck", at=0.3, duration=0.1)
        rig.run(0.5)
    (folder / "signals" / "controller.csv").unlink()
    assert canarm_here(["replay", str(folder), "--check"]) == 0
    assert "the same: every byte of can0" in capsys.readouterr().out
    change_record(folder, "rig", seed=1)
    assert canarm_here(["replay", str(folder), "--check"]) == 1
    assert "differs first: recorded at 0.000000 s 594#" in capsys.readouterr().out, "its noise, in the first code read"


@pytest.mark.parametrize("changes", [{"seed": 6}, {"truth": {"joint3.mass": "0.91"}}, {"law": "pd"}], ids=str)
def test_another_seed_truth_or_law_is_another_run(
    copy: Path, changes: dict[str, object], capsys: pytest.CaptureFixture[str]
) -> None:
    change_record(copy, "rig", **changes)
    assert canarm_here(["replay", str(copy), "--check"]) == 1
    assert " differs first: recorded at " in capsys.readouterr().out


def test_where_a_difference_may_come_from_another_machine_that_is_said(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    versions = {**json.loads((copy / "run.json").read_text())["rig"]["versions"], "numpy": "1.26.4"}
    change_record(copy, "rig", processor="Z80\x1b[2J", versions=versions)
    assert canarm_here(["replay", str(copy), "--check"]) == 0
    assert "rounded otherwise" not in capsys.readouterr().err, "nothing differs: nobody asks why"
    change_record(copy, "rig", seed=6)
    assert canarm_here(["replay", str(copy), "--check"]) == 1
    told = capsys.readouterr().err
    assert "it was made with processor Z80\\x1b[2J (here " in told
    assert f"numpy 1.26.4 (here {np.__version__})" in told


def test_what_others_say_after_the_end_of_a_run_does_not_count_against_it(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A second controller that is refused resets the cards and reads their objects; it never sends SYNC."""
    log = (copy / "can0.log").read_text()
    change_record(copy, "summary", state="done")
    stamp = log.splitlines()[-1].split(" can0 ")[0]
    refused = "".join(f"{stamp} can0 {text}\n" for text in ("000#8112", "712#00", "612#4000100000000000"))
    (copy / "can0.log").write_text(log + refused)
    assert canarm_here(["replay", str(copy), "--check"]) == 0
    frames = log.count("\n")
    told = "the same: every byte of can0 up to the end of its controller"
    assert capsys.readouterr().out == f"{told} ({frames} frames); not compared: 3 frames after it\n"
    (copy / "can0.log").write_text(f"{log}{refused}{stamp} can0 080#01\n")
    assert canarm_here(["replay", str(copy), "--check"]) == 1
    assert "then the recorded run goes on: 000#8112 (NMT: reset-node to dac)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("event", "what"), [("emergency-stop", "the emergency stop"), ("power-cycle", "the power cycle")]
)
def test_a_run_is_compared_up_to_what_was_done_by_hand(
    event: str, what: str, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (copy / "can0.log").read_text().splitlines(keepends=True)
    power_on_s = float(lines[2000][1:18]) - 1.0  # the log's clock shows 1 s at power-on
    with (copy / "events.jsonl").open("a") as file:
        named = {"time_s": power_on_s, "source": "emulator", "event": event, "cycle": 99, "power_on_s": power_on_s}
        file.write(json.dumps(named) + "\n")
    stamp, _, name = lines[-1].rpartition(" ")
    (copy / "can0.log").write_text("".join([*lines[:-1], f"{stamp} 7FF#{name.partition('#')[2]}"]))
    assert canarm_here(["replay", str(copy), "--check"]) == 0
    told = capsys.readouterr().out
    assert told.startswith(f"the same: every byte of can0 up to {what} at {power_on_s:.4f} s (20")
    lines[1500] = lines[1500].replace("#", "#00", 1)
    (copy / "can0.log").write_text("".join(lines))
    assert canarm_here(["replay", str(copy), "--check"]) == 1


def test_the_first_frame_that_differs_is_named_and_decoded(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """DAC code c travels as c << 7 in 16 bits (CiA 401): 0x0080 is code 1."""
    lines = (copy / "can0.log").read_text().splitlines(keepends=True)
    place = next(i for i, line in enumerate(lines) if " 312#" in line and i > 1000)
    stamp = lines[place].split("312#")[0]
    lines[place] = f"{stamp}312#80008000\n"
    (copy / "can0.log").write_text("".join(lines))
    assert canarm_here(["replay", str(copy), "--check"]) == 1
    told = capsys.readouterr().out
    assert told.startswith(f"frame {place + 1} differs first: recorded at ")
    # 0x0080 is code 1, and 1.5 A / 255 are 0.0059 A.
    said = "312#80008000 (RPDO2 of dac: joint2.current_command 0.0059 A, joint3.current_command 0.0059 A), now at "
    assert said in told


def test_a_law_in_a_file_is_executed_only_when_it_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "laws.py"
    file.write_text(LAW)
    with Rig(law=f"{file}:Mine", out=tmp_path / "run") as rig:
        rig.run(0.25)
    (tmp_path / "executed").unlink()
    assert canarm_here(["replay", str(tmp_path / "run"), "--check"]) == 2
    told = capsys.readouterr().err
    assert f"its law '{file}:Mine' is none of ours; if you trust it, name it with --law" in told
    assert not (tmp_path / "executed").exists()
    assert canarm_here(["replay", str(tmp_path / "run"), "--check", "--law", f"{file}:Mine"]) == 0


@pytest.mark.parametrize(
    ("section", "changes", "why"),
    [
        ("rig", {"seed": "x" * 500}, "seed"),
        ("rig", {"truth": ["joint3.mass"]}, "truth: must be keys and values"),
        ("rig", {"truth": {"joint9.mass": 1}}, "joint9"),
        ("rig", {"trajectory": "/etc/passwd"}, "its trajectory '/etc/passwd' is none of ours"),
        ("rig", {"clock": "wall"}, "ran on the wall clock, which nobody can repeat"),
        ("summary", {"ticks": 10**30}, "of the number of its cycles; nothing can be repeated"),
        ("cell", {"bus": {"cycle_us": "\x1b[2J"}}, "run.json: cell"),
    ],
)
def test_what_cannot_be_repeated_is_said(
    copy: Path, section: str, changes: dict[str, object], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    change_record(copy, section, **changes)
    assert canarm_here(["replay", str(copy), "--check"]) == 2
    told = capsys.readouterr().err
    assert why in told
    assert "should not happen" not in told
    assert told.isprintable() or all(line.isprintable() for line in told.splitlines())


def test_every_frame_reaches_a_bus_in_its_order(eventful: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with can.Bus(interface="virtual", channel="replayed") as bus:
        words = ["-i", "virtual", "-c", "replayed", "--speed", "max"]
        assert canarm_here(["replay", str(eventful), *words]) == 0
        heard = []
        while (message := bus.recv(0.0)) is not None:
            heard.append((message.arbitration_id, bytes(message.data)))
    with can.CanutilsLogReader(eventful / "can0.log") as reader:
        logged = [(each.arbitration_id, bytes(each.data)) for each in reader if not each.is_error_frame]
    assert heard == logged
    assert capsys.readouterr().out == f"{len(logged)} frames sent\n"


class SlowBus:
    """A port and a clock: notes when frames are sent."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.sent: list[tuple[float, int]] = []

    def send(self, frames: list[Frame]) -> None:
        self.sent += [(round(self.now_s - 100.0, 9), frame.can_id) for frame in frames]

    def receive(self, wait_s: float) -> list[tuple[int, Frame]]:
        return []

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0, math.inf])
def test_frames_leave_at_their_times_at_the_chosen_speed(speed: float) -> None:
    bus = SlowBus()
    frames = [(round(at_s * 1e9), Frame(can_id)) for can_id, at_s in enumerate((7.0, 7.0, 7.3, 9.0, 9.0025))]
    done = replay_timed(frames, bus, speed, lambda: bus.now_s, bus.sleep)  # type: ignore[arg-type]
    times = [0.0, 0.0, 0.3, 2.0, 2.0025]
    assert [can_id for _, can_id in bus.sent] == [0, 1, 2, 3, 4]
    assert [at_s for at_s, _ in bus.sent] == pytest.approx([at_s / speed for at_s in times])
    assert done.frames == 5


def test_what_a_master_sent_drives_an_emulator_again_over_a_bus(canarm, run_folder, eventful: Path) -> None:
    with Rig(law="pd", seed=0, out=canarm.folder / "first") as rig:
        rig.run(0.5)
    emulator = canarm.emulator("sync", "--out", "second")
    replayed = canarm("replay", "first", "--master", "-i", "canarm", "-c", "can0", f"port={emulator.port}")
    assert replayed.wait() == 0, replayed
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0
    first, second = ((canarm.folder / name / "can0.log").read_bytes() for name in ("first", "second"))
    assert first == second
    assert sum(1 for _ in log_frames(canarm.folder / "second" / "can0.log")) > 1000


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ([], "to which bus? -i canarm -c can0"),
        (["--speed", "0"], "must be a multiple of the recorded speed"),
        (["--law", "pd"], "--law and --trajectory are for --check"),
        (["--check", "-i", "virtual"], "leave the options of a bus out"),
    ],
)
def test_a_wrong_command_line_is_said(
    eventful: Path, words: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert canarm_here(["replay", str(eventful), *words]) == 2
    assert why in capsys.readouterr().err


def test_what_is_no_log_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "noise.log").write_bytes(b"\x1b[2J" * 1000)
    assert canarm_here(["replay", str(tmp_path / "noise.log"), "-i", "virtual", "-c", "a"]) == 2
    assert "has no frames; is it a candump log?" in capsys.readouterr().err
