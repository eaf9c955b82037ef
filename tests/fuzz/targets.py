"""What strangers can say to canarm, one target per door: bytes go in, and only the errors of that door may come out.

A target takes any bytes and returns; an exception that it lets pass has escaped. `make fuzz` drives the same targets
guided by coverage, the tests beside this file with a few thousand inputs of a fixed seed.
"""

import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path

from canarm_controller.cooperation import read_path
from canarm_controller.errors import ControllerError
from canarm_controller.reference.trajectory_file import read_trajectory_csv
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_emulator.serving.slcan import SlcanAdapter
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame
from canarm_protocol.cell.cell_file import load_cell, parse_cell
from canarm_protocol.clock import Clock
from canarm_protocol.errors import ProtocolError
from canarm_protocol.faults.bench_answers import plain_of, unpacked
from canarm_protocol.faults.conditions import Condition
from canarm_protocol.faults.script import parse_faults
from canarm_protocol.runs.run_folder import read_run_file
from canarm_protocol.transport.socketcand import ClientParser
from canarm_protocol.transport.socketcand_server import ServerParser

CELL = load_cell("konkuk1")
FRAMES_AN_INPUT = 16
SERVED_FRAMES = 20_000
"""After so many frames a bench is replaced, so that no input depends on a long past."""


class _Benches:
    """A bench that takes frames, as after NMT start; replaced from time to time."""

    def __init__(self) -> None:
        self._left = 0
        self._bench: FaultBench | None = None

    def take(self, frames: list[Frame]) -> None:
        if self._bench is None or self._left <= 0:
            self._bench = FaultBench(CELL, Truth.from_settings(CELL, {}), Clock.WALL, 0)
            self._bench.start()
            self._bench.receive(nmt_frame(NmtCommand.START, 0))
            self._left = SERVED_FRAMES
        for number, frame in enumerate(frames):
            if number % 2:
                self._bench.receive_bench(frame)
            self._bench.receive(frame)
        self._bench.advance(self._bench.time_ns + 1_000_000)
        self._bench.records, self._bench.bench_records = [], []
        self._left -= len(frames)


_benches = _Benches()


def _said(error: Exception) -> None:
    """A refusal says something, on lines that a terminal can show."""
    text = str(error)
    assert text, repr(error)
    assert all(line.isprintable() for line in text.split("\n")), repr(text)


def frames(data: bytes) -> None:
    """Frames on both buses of a bench: a byte of flags and length, two or four of identifier, the data."""
    found = []
    while len(data) >= 3 and len(found) < FRAMES_AN_INPUT:
        flags, size = data[0], data[0] & 0x0F
        is_extended, is_remote = bool(flags & 0x10), bool(flags & 0x20)
        if is_extended and len(data) < 5:
            break
        start = 5 if is_extended else 3
        can_id = int.from_bytes(data[1:start], "little") & (0x1FFFFFFF if is_extended else 0x7FF)
        found.append(Frame(can_id, data[start : start + min(size, 8)], is_extended, is_remote))
        data = data[start + min(size, 8) :]
    _benches.take(found)


def socketcand(data: bytes) -> None:
    """What a client says to the hub, and what a server says to our client, cut in two at any place."""
    at = data[0] % (len(data) or 1) if data else 0
    for parser in (ServerParser(), ClientParser()):
        parser.feed(data[:at])
        parser.feed(data[at:])


def slcan(data: bytes) -> None:
    """What a client says to a serial adapter; its answers are bounded by what it said."""
    adapter = SlcanAdapter()
    adapter.feed(b"S8\rO\r")
    _, answers = adapter.feed(data)
    assert len(answers) <= 64 * (len(data) + 1)


def toml(data: bytes) -> None:
    """A cell, and a fault script."""
    text = data.decode("utf-8", "replace")
    for read in (parse_cell, parse_faults):
        try:
            read(text, "input")
        except ProtocolError as error:
            _said(error)


def conditions(data: bytes) -> None:
    """A condition of a fault, and its value."""
    known = ("joint2.angle_deg", "time_s")
    try:
        condition = Condition(data.decode("utf-8", "replace"), known)
    except ProtocolError as error:
        _said(error)
    else:
        condition.holds(dict.fromkeys(known, 1.5))


def trajectories(data: bytes) -> None:
    """A trajectory file."""
    with tempfile.TemporaryDirectory(dir=_memory()) as folder:
        path = Path(folder) / "input.csv"
        path.write_bytes(data)
        try:
            read_trajectory_csv(path, CELL.joint_names)
        except ControllerError as error:
            _said(error)


def paths(data: bytes) -> None:
    """A path of two arms' object."""
    with tempfile.TemporaryDirectory(dir=_memory()) as folder:
        path = Path(folder) / "input.csv"
        path.write_bytes(data)
        try:
            read_path(path)
        except ControllerError as error:
            _said(error)


def packed(data: bytes) -> None:
    """A packed object of the bench node as its clients read it: the bytes themselves, and the bytes as its content."""
    for payload in (data, zlib.compress(data, 1)):
        try:
            for line in unpacked(payload).splitlines():
                plain_of(line, dict)
        except ValueError as error:
            _said(error)


def run_folders(data: bytes) -> None:
    """`run.json` of somebody's run folder."""
    with tempfile.TemporaryDirectory(dir=_memory()) as folder:
        (Path(folder) / "run.json").write_bytes(data)
        try:
            read_run_file(Path(folder))
        except ProtocolError as error:
            _said(error)


def _memory() -> str | None:
    """A file system in memory, where there is one."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


TARGETS: dict[str, Callable[[bytes], None]] = {
    each.__name__: each
    for each in (frames, socketcand, slcan, toml, conditions, trajectories, paths, packed, run_folders)
}

SEEDS: dict[str, list[bytes]] = {
    "frames": [
        b"\x02\x00\x00\x01\x00",
        b"\x08\x14\x06\x40\x00\x10\x00\x00\x00\x00\x00",
        b"\x08\x12\x06\x23\x11\x64\x01\x00\x10\x00\x00",
        b"\x04\x12\x02\x00\x10\x00\x10",
        b"\x08\x70\x06\x21\x00\x24\x00\x08\x00\x00\x00",
    ],
    "socketcand": [
        b"\x00< open can0 >< rawmode >< send 123 2 1 7f >",
        b"\x09< subscribe 0 0 123 >< statistics 1000 >< frame 123 1.0 0102 >",
    ],
    "slcan": [b"t1232AABB\r", b"T1FFFFFFF80011223344556677\r", b"r1230\rV\rN\rC\r"],
    "toml": [
        b'[[set]]\nname = "a"\nat = 1.0\n[[set.fault]]\ntap = "joint2.tachometer"\nfault = "stuck"\n',
        b'name = "x"\n[bus]\nbitrate = 1_000_000\n',
    ],
    "conditions": [b"joint2.angle_deg > 30 and time_s > 1", b"not (abs(joint2.angle_deg) < 1e3)"],
    "trajectories": [b"time_s,joint2,joint3\n0,20,0\n3,20,0\n3.5,45,0\n"],
    "paths": [b"time_s,x_mm,y_mm,z_mm\n0,20,0,1\n3,20,0,5e2\n3.5,45,0,0\n", b"z_m,time_s,x_m,y_m\n1,0,2,3\n1,1,2,3\n"],
    "packed": [b'{"event":"fault begins","set":"a","tap":"b","fault":"c","time_s":1.0,"cycle":400}\n'],
    "run_folders": [b'{"cell": "konkuk1", "state": "done", "ticks": 4096}', b"null", b'["cell"]'],
}
"""Inputs that mean something, from which mutations begin."""
