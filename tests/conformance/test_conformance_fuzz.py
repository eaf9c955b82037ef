"""Random, mutated and cut frames on the in-process link: nothing escapes, nothing grows, the cards still answer."""

import gc
import random
import tracemalloc

import pytest

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.canopen.sdo import download, upload
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock

CELL = load_cell("konkuk1")
NODE_IDS = [card.node_id for card in CELL.card]
US = 1_000
SERVICES = (0x000, 0x080, 0x100, 0x180, 0x200, 0x280, 0x300, 0x380, 0x580, 0x600, 0x700)
OBJECTS = [(index, sub) for index in (*range(0x1000, 0x1030), 0x1200, 0x2000, 0x2010) for sub in range(3)]
OBJECTS += [(base + pdo, sub) for base in (0x1400, 0x1600, 0x1800, 0x1A00) for pdo in range(3) for sub in range(7)]
OBJECTS += [(index, sub) for index in (*range(0x6200, 0x6209), *range(0x6400, 0x6445)) for sub in range(9)]
GROWTH_BYTES = 256 * 1024
"""Far below what one leaked object a frame would make."""


class Fuzzer:
    """Frames from one seed: noise, services of the nodes, SDO dialogues that are mutated, cut and mixed."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)

    def frames(self) -> list[Frame]:
        """A few frames that belong together."""
        choose = self._random.random()
        if choose < 0.25:
            return [self._noise()]
        if choose < 0.45:
            return [self._service()]
        if choose < 0.47:
            return [nmt_frame(self._random.choice(list(NmtCommand)), self._random.choice([0, *NODE_IDS]))]
        if choose < 0.49:
            return [sync_frame(self._random.choice([None, 1, 30, 240]))]
        return self._dialogue()

    def _bytes(self, size: int) -> bytes:
        return self._random.randbytes(size)

    def _noise(self) -> Frame:
        is_extended = self._random.random() < 0.3
        can_id = self._random.getrandbits(29 if is_extended else 11)
        return Frame(can_id, self._bytes(self._random.randint(0, 8)), is_extended, self._random.random() < 0.2)

    def _service(self) -> Frame:
        can_id = self._random.choice(SERVICES) + self._random.choice([0, 1, *NODE_IDS])
        data = self._bytes(self._random.choice([0, 1, 2, 6, 7, 8]))
        is_sync = can_id == 0x080  # each of them costs a cycle of the world: there are others
        return Frame(can_id, data, is_sync or self._random.random() < 0.05, self._random.random() < 0.1)

    def _dialogue(self) -> list[Frame]:
        index, subindex = self._random.choice(OBJECTS)
        if self._random.random() < 0.7:
            value = self._random.choice([self._bytes(4), bytes(4), b"\0\0\0\x80", b"save", b"load", b"\xff" * 4])
            transfer = download(index, subindex, (value * 6)[: self._random.choice([1, 1, 2, 2, 4, 4, 4, 5, 20])])
        else:
            transfer = upload(index, subindex)
        requests = [next(transfer), *(self._segment() for _ in range(self._random.randint(0, 3)))]
        if self._random.random() < 0.3:
            broken = bytearray(self._random.choice(requests))
            broken[self._random.randrange(8)] ^= 1 << self._random.randrange(8)
            requests.insert(self._random.randrange(len(requests) + 1), bytes(broken))
        can_id = 0x600 + self._random.choice(NODE_IDS)
        return [Frame(can_id, request) for request in requests[: self._random.randint(1, len(requests))]]

    def _segment(self) -> bytes:
        return bytes((self._random.choice([0x00, 0x10, 0x01, 0x11, 0x60, 0x70, 0x80]),)) + self._bytes(7)


def fuzz(bench: FaultBench, fuzzer: Fuzzer, count: int) -> None:
    sent = 0
    while sent < count:
        for frame in fuzzer.frames():
            bench.receive(frame)
            sent += 1
        if bench.clock is Clock.WALL:
            bench.advance(bench.time_ns + 50 * US)
        bench.records.clear()
        bench.bench_records.clear()


@pytest.mark.parametrize("clock", list(Clock))
@pytest.mark.parametrize(
    "count", [pytest.param(10_000, id="10^4"), pytest.param(1_000_000, id="10^6", marks=pytest.mark.slow)]
)
@pytest.mark.timeout(1800)
def test_no_frame_breaks_the_cards_and_none_makes_them_grow(count: int, clock: Clock) -> None:
    """Everything at once: ID, length, RTR, extended, SDO sequences cut anywhere (in-process link alone)."""
    bench = FaultBench(CELL, Truth.from_settings(CELL, {}), clock, seed=0)
    bench.start()
    fuzzer = Fuzzer(seed=count)
    fuzz(bench, fuzzer, count // 2)
    tracemalloc.start()
    try:
        fuzz(bench, fuzzer, count // 20)
        gc.collect()
        before, _ = tracemalloc.get_traced_memory()
        fuzz(bench, fuzzer, count // 20)
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < GROWTH_BYTES
    fuzz(bench, fuzzer, count - count // 2 - 2 * (count // 20))
    for node_id in NODE_IDS:
        bench.receive(nmt_frame(NmtCommand.PRE_OPERATIONAL, node_id))
        bench.receive(Frame(0x600 + node_id, next(download(0x1011, 1, b"load"))))
    bench.receive(nmt_frame(NmtCommand.RESET_NODE))
    bench.advance(bench.time_ns + 1_000_000 * CELL.bus.boot_ms)
    bench.records.clear()
    for node_id in NODE_IDS:
        bench.receive(Frame(0x600 + node_id, next(upload(0x1000, 0))))
        assert bench.records[-1].frame.data[:4] == b"\x43\x00\x10\x00"
    bench.receive(nmt_frame(NmtCommand.START))
    bench.receive(sync_frame(1))
    bench.advance(bench.time_ns + 1000 * US)
    assert {0x294, 0x394} <= {record.frame.can_id for record in bench.records}
