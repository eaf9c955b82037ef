"""A bench of konkuk1 without a bus: frames of a master go in, and what is on the robot's bus comes out."""

import struct

from canarm_emulator.bench.bench import Record
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.canopen.sdo import download
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.output_frames import OutputFrames
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.clock import Clock

CELL = load_cell("konkuk1")
NODES = card_nodes(CELL)
DAC, LATCH, ADC, MASTER, BENCH = 0x12, 0x13, 0x14, 1, 0x70
US, MS = 1_000, 1_000_000
CYCLE_NS, SCAN_NS = 2_500 * US, 6 * 100 * US  # six channels of the ADC are wired
START = nmt_frame(NmtCommand.START)
NOISELESS = {f"{joint}.noise_lsb": "0" for joint in CELL.joint_names}
CLOCKWISE, COUNTER_CLOCKWISE = 0b01, 0b10


def new_bench(clock: Clock = Clock.SYNC, seed: int = 0, settings: dict[str, str] | None = None) -> FaultBench:
    bench = FaultBench(CELL, Truth.from_settings(CELL, settings or {}), clock, seed)
    bench.start()
    return bench


def take(bench: FaultBench) -> list[tuple[int, Frame]]:
    """What is on the robot's bus since the last look: time and frame."""
    records, bench.records = bench.records, []
    return [(record.time_ns, record.frame) for record in records]


def ids(bench: FaultBench) -> list[tuple[int, int]]:
    return [(time_ns, frame.can_id) for time_ns, frame in take(bench)]


def write(bench: FaultBench, node_id: int, index: int, subindex: int, data: bytes) -> None:
    """One expedited SDO download."""
    bench.receive(Frame(0x600 + node_id, next(download(index, subindex, data))))
    assert bench.records[-1].frame.data[0] == 0x60


def watch(bench: FaultBench, node_id: int, watched: int, timeout_ms: int) -> None:
    write(bench, node_id, 0x1016, 1, struct.pack("<I", watched << 16 | timeout_ms))


def send_outputs(bench: FaultBench, codes: tuple[int, int], directions: tuple[int, int]) -> None:
    for cob_id, data, *_ in OutputFrames(CELL, NODES).frames(codes, directions):
        bench.receive(Frame(cob_id, data + bytes(8 - len(data)) if cob_id == 0x312 else data))


def run_cycles(bench: FaultBench, count: int) -> list[Record]:
    """Cycles of a controller that swings both arms."""
    records: list[Record] = []
    for k in range(count):
        swing = COUNTER_CLOCKWISE if k // 40 % 2 else CLOCKWISE
        send_outputs(bench, (60 + k % 16, 30), (swing, swing ^ 0b11))
        bench.receive(sync_frame(None))
        records += bench.records
        bench.records.clear()
    return records
