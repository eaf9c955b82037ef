"""Detections of a controller as clients of the bench read them, from the frames that bring them."""

import json
import zlib

import pytest

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell import bench_objects as objects
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.faults.detection_events import (
    DetectionEvent,
    Pieces,
    detection_as_plain,
    detection_from_plain,
    pieces_of,
)
from tests.emulator.bench_sdo import Client

CELL = load_cell("konkuk1")
LAYOUT = objects.bench_pdos(CELL).detection
STUCK = DetectionEvent(
    1207, "tachometer-stuck", "joint2", "joint2: 0.4 rad/s of motion, no change – 10 cycles", "substitute"
)
LATE = DetectionEvent(1300, "deadline-missed", None, "a busy machine: 12 of 400 cycles", "safe-stop-hold")


def frames_of(event: DetectionEvent) -> list[Frame]:
    return [Frame(LAYOUT.cob_id, LAYOUT.pack(piece)) for piece in pieces_of(event)]


def crc16_ccitt(data: bytes) -> int:
    """As CiA 301 writes it for SDO block transfer: x^16 + x^12 + x^5 + 1, from 0, bit by bit."""
    crc = 0
    for byte in data:
        for bit in range(7, -1, -1):
            crc = crc << 1 ^ (0x1021 if (crc >> 15 ^ byte >> bit) & 1 else 0)
            crc &= 0xFFFF
    return crc


def test_a_text_travels_in_order_between_stx_and_nul_with_its_checksum() -> None:
    data = b"".join(frame.data for frame in frames_of(STUCK))
    assert data[:1] == b"\2"
    text, _, rest = data[5:].partition(b"\0")
    assert not rest.strip(b"\0")
    assert int(data[1:5], 16) == crc16_ccitt(text)
    assert json.loads(text.decode("ascii")) == {
        "time_ns": 0,
        "event": "detection",
        "cycle": 1207,
        "detector": "tachometer-stuck",
        "where": "joint2",
        "detail": STUCK.detail,
        "reaction": "substitute",
    }


def test_what_a_controller_detects_can_be_read_by_every_client(bench: FaultBench, client: Client) -> None:
    assert client.text(objects.DETECTION_EVENTS) == "\n"
    for frame in frames_of(STUCK) + frames_of(LATE):
        bench.receive_bench(frame, "controller")
    heard = [event._replace(time_ns=bench.time_ns) for event in (STUCK, LATE)]
    lines = client.text(objects.DETECTION_EVENTS).splitlines()
    assert [json.loads(line) for line in lines] == [detection_as_plain(event) for event in heard]
    assert zlib.decompress(client.read(objects.PACKED_DETECTIONS)).decode().splitlines() == lines
    assert [detection_from_plain(json.loads(line)) for line in lines] == heard
    assert client.read(objects.DETECTIONS) == b"\2\0"
    assert client.read(objects.BROKEN_DETECTIONS) == b"\0\0"


def test_telemetry_counts_the_detections(bench: FaultBench) -> None:
    for frame in frames_of(LATE) * 3:
        bench.receive_bench(frame, "controller")
    layout = objects.bench_pdos(CELL).faults
    bench.bench_records.clear()
    bench.send_telemetry()
    (data,) = [each.frame.data for each in bench.bench_records if each.frame.can_id == layout.cob_id]
    assert layout.unpack(data)[-1] == 3


def test_the_last_hundred_are_kept_and_all_are_counted(bench: FaultBench, client: Client) -> None:
    for number in range(130):
        for frame in frames_of(STUCK._replace(cycle=number)):
            bench.receive_bench(frame, "controller")
    lines = client.text(objects.DETECTION_EVENTS).splitlines()
    assert [json.loads(line)["cycle"] for line in lines] == list(range(30, 130))
    assert client.read(objects.DETECTIONS) == bytes((130, 0))


@pytest.mark.parametrize("lost", range(len(frames_of(STUCK))))
def test_a_lost_piece_costs_one_detection_and_is_counted(lost: int) -> None:
    pieces = Pieces()
    values = list(pieces_of(STUCK))
    del values[lost]
    heard = [event for value in (*values, *pieces_of(LATE)) if (event := pieces.take(value)) is not None]
    assert heard == [LATE]
    assert pieces.broken == 1


def test_a_long_detail_is_cut() -> None:
    pieces = Pieces()
    (event,) = [got for value in pieces_of(STUCK._replace(detail="é" * 5000)) if (got := pieces.take(value))]
    assert event.detail == "é" * 199 + "…"


def test_strangers_texts_are_bounded_and_counted() -> None:
    pieces = Pieces()
    for value in [int.from_bytes(b"\2[[[[[[[", "little")] + [int.from_bytes(b"[" * 8, "little")] * 1000 + [0]:
        assert pieces.take(value) is None
    assert pieces.broken > 0
    line = b'{"cycle":"x","where":null,"detector":1,"detail":2,"reaction":3}'
    nonsense = b"\2" + f"{crc16_ccitt(line):04x}".encode() + line + b"\0"
    nonsense += bytes(-len(nonsense) % 8)
    for first in range(0, len(nonsense), 8):
        assert pieces.take(int.from_bytes(nonsense[first : first + 8], "little")) is None
