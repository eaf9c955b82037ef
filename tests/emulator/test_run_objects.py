"""The bench node's objects of a run as a whole: how it has ended, and its record, switched off and on again."""

import struct

import pytest

from canarm_emulator.bench_node.run_objects import RunObjects
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.sdo import SdoAborted, download
from canarm_protocol.cell import bench_objects as objects
from canarm_protocol.cell.cell_file import load_cell
from tests.emulator.bench_sdo import Client

CELL = load_cell("konkuk1")
STATE = objects.bench_pdos(CELL).controller
DEVICE_STATE, TOO_LONG, TOO_HIGH = 0x0800_0022, 0x0607_0012, 0x0609_0031


def report(bench: FaultBench, state: int) -> None:
    bench.receive_bench(Frame(STATE.cob_id, STATE.pack(7, 0, state)), "controller")


def refusal(client: Client, index: int, data: bytes) -> int:
    with pytest.raises(SdoAborted) as caught:
        client.run(download(index, 0, data))
    return caught.value.code


class Disk:
    """Who records in `place`."""

    def __init__(self) -> None:
        self.is_on, self.place, self.failure = True, "/runs/été", None

    def switch(self, is_on: bool) -> None:
        self.is_on = is_on


def test_the_outcome_is_read_as_it_was_written_and_gone_when_another_run_goes_on(
    bench: FaultBench, client: Client
) -> None:
    assert client.read(objects.OUTCOME) == b"\n"
    report(bench, 5)
    text = "FAILED: konkuk1\ntachometer-stuck: 0 V – broken".encode()
    client.run(download(objects.OUTCOME, 0, text))
    report(bench, 5)
    assert client.read(objects.OUTCOME) == text
    for state in (2, 6):
        client.run(download(objects.OUTCOME, 0, text))
        report(bench, state)
        assert client.read(objects.OUTCOME) == b"\n"


def test_an_outcome_without_end_is_refused(client: Client) -> None:
    client.run(download(objects.OUTCOME, 0, b"x" * 4000))
    assert refusal(client, objects.OUTCOME, b"x" * 4001) == TOO_LONG


def test_without_a_record_nothing_can_be_recorded_and_the_reason_is_read(client: Client) -> None:
    assert client.read(objects.RECORDING) == b"\0"
    assert refusal(client, objects.RECORDING, b"\1") == DEVICE_STATE
    assert "emulator was started without --out" in client.text(objects.RECORD_PLACE)
    client.run(download(objects.RECORDING, 0, b"\0"))


def test_the_record_is_switched_off_and_on(bench: FaultBench, client: Client) -> None:
    disk = Disk()
    bench.device.run.attach(disk, disk.switch)
    assert client.read(objects.RECORDING) == b"\1"
    for value in (0, 1, 1):
        client.run(download(objects.RECORDING, 0, bytes((value,))))
        assert client.read(objects.RECORDING) == bytes((value,))
    assert client.text(objects.RECORD_PLACE) == r"/runs/\xe9t\xe9"
    assert refusal(client, objects.RECORDING, struct.pack("<B", 2)) == TOO_HIGH


def test_on_a_full_disk_nothing_is_recorded_any_more(bench: FaultBench, client: Client) -> None:
    disk = Disk()
    bench.device.run.attach(disk, disk.switch)
    disk.failure = "can0.log: no space left"
    assert client.read(objects.RECORDING) == b"\0"
    assert refusal(client, objects.RECORDING, b"\1") == DEVICE_STATE
    assert client.text(objects.RECORD_PLACE) == "not recorded any more: can0.log: no space left"


def test_who_asks_only_for_what_is_already_so_switches_nothing() -> None:
    run, disk, asked = RunObjects(), Disk(), []
    run.attach(disk, asked.append)
    run.record(True)
    assert asked == []
