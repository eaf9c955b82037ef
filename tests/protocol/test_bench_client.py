"""The client of a bench, against benches that mean no good: nothing fills its memory, and nothing holds it for ever."""

import struct
import tracemalloc
import zlib

import pytest

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.sdo import LARGEST_UPLOAD
from canarm_protocol.cell import bench_objects as objects
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.errors import BusError
from canarm_protocol.faults import bench_answers
from canarm_protocol.faults.bench_client import BenchClient

CELL = load_cell("konkuk1")
CLAIM_REQUEST, CLAIM_ANSWER = objects.sdo_channel(CELL.bus.bench_node_id, objects.CLAIM_CHANNEL)


class HostileBench:
    """A bus with a bench node that grants every claim and answers each upload with `value`, or without end."""

    description = "hostile"

    def __init__(self, value: bytes | None) -> None:
        self._value = value
        self._sent = 0
        self._toggle = 0
        self._token = bytes(4)
        self._answers: list[tuple[int, Frame]] = []

    def send(self, frames: list[Frame]) -> None:
        for frame in frames:
            if frame.can_id == CLAIM_REQUEST:
                self._claim(frame.data)
            else:
                self._answers.append((0, Frame(frame.can_id - 0x80, self._answer(frame.data))))

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        answers, self._answers = self._answers, []
        return answers

    def _claim(self, request: bytes) -> None:
        head = request[1:4]
        if request[0] == 0x40:
            self._answers.append((0, Frame(CLAIM_ANSWER, b"\x43" + head + self._token)))
        else:
            self._token = request[4:]
            self._answers.append((0, Frame(CLAIM_ANSWER, b"\x60" + head + bytes(4))))

    def _answer(self, request: bytes) -> bytes:
        if request[0] >> 5 != 3:  # an upload begins
            self._sent, self._toggle = 0, 0
            size = struct.pack("<I", len(self._value)) if self._value is not None else bytes(4)
            return bytes((0x40 | (self._value is not None),)) + request[1:4] + size
        command, self._toggle = self._toggle, self._toggle ^ 0x10
        if self._value is None:
            return bytes((command,)) + b"endless"
        part = self._value[self._sent : self._sent + 7]
        self._sent += 7
        last = self._sent >= len(self._value)
        return bytes((command | (7 - len(part)) << 1 | last,)) + part.ljust(7, b"\0")


def refusal(value: bytes | None, read: str) -> str:
    with BenchClient(HostileBench(value), CELL) as client:
        with pytest.raises(BusError) as caught:
            getattr(client, read)()
        return str(caught.value)


def test_an_upload_without_end_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("canarm_protocol.canopen.sdo.upload.__defaults__", (10_000,))
    assert "out of memory" in refusal(None, "status")


def test_an_object_that_is_announced_as_larger_than_any_is_not_taken() -> None:
    assert "out of memory" in refusal(bytes(LARGEST_UPLOAD + 1), "status")


def test_what_unpacks_to_more_than_makes_sense_is_not_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_answers, "LARGEST_UNPACKED", 100_000)
    packed = zlib.compress(bytes(20_000_000), 9)
    assert len(packed) < 20_000
    tracemalloc.start()
    try:
        assert "longer than 100000 bytes" in refusal(packed, "catalogue")
        assert tracemalloc.get_traced_memory()[1] < 2_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("value", "read"),
    [
        (b"no zlib at all", "catalogue"),
        (zlib.compress(b"[]" * 100)[:-6], "catalogue"),
        (zlib.compress(b"{}"), "catalogue"),
        (zlib.compress(b"[" * 100_000), "catalogue"),
        (zlib.compress(b"[]\n"), "events"),
        (zlib.compress(b"\xff\xfe\n"), "events"),
        (b"[1, 2]", "status"),
        (b"[" * 100_000, "status"),
        (b"9" * 5000, "status"),
        (b"\xff\xff\xff\xff\xff", "status"),
    ],
)
def test_what_makes_no_sense_is_said_in_one_line(value: bytes, read: str) -> None:
    text = refusal(value, read)
    assert text.startswith("bench node 0x70: ")
    assert len(text.splitlines()) == 1


def test_a_bench_that_answers_slowly_for_ever_is_given_up_in_time() -> None:
    class Clock:
        now_s = 0.0

    class Slow(HostileBench):
        def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
            Clock.now_s += 0.9
            return super().receive(timeout_s)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("time.monotonic", lambda: Clock.now_s)
        with BenchClient(Slow(None), CELL, limit_s=1.0) as client:
            began_s = Clock.now_s
            with pytest.raises(BusError, match=r"no end of SDO transfer \(0x5B\d\) within 60 s"):
                client.status()
            assert Clock.now_s - began_s < 70.0
