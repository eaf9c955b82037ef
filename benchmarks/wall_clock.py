"""How regularly SYNC arrives on the wall clock: our controller against a bare loop that sleeps to absolute deadlines.

Arrival is measured in the process that serves the bus, behind the same hub, for both. The bare loop sends a SYNC over
the same client and does nothing else: what is left is the machine and the transport. Blocks alternate, so that other
load on the machine affects both. First as the controller runs without options; then, if permitted, with
every process in a real-time class, which excludes most other load.
"""

import contextlib
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from typing import Any

from measure import Ratio, Row

from canarm.session import make_bench, make_controller
from canarm_controller.run.runner import Runner, RunResult
from canarm_controller.run.state import State
from canarm_emulator.serving.hub import Hub
from canarm_emulator.serving.hub_events import Detached, Event, Received
from canarm_emulator.serving.runner import EmulatorRunner
from canarm_emulator.serving.sync_intervals import SyncIntervals
from canarm_protocol.canopen.frames import Cob, sync_frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock
from canarm_protocol.transport.port import open_port
from canarm_protocol.transport.realtime import PRIORITY

BLOCKS = 10
CYCLES = 600
"""Cycles per block: 1.5 seconds, whose 99th percentile is the sixth largest of 600."""
RATES_HZ = (400, 500, 625, 800, 900)
"""Rates to search. Conversion of six channels (0.6 ms) and the cell's compute delay (0.5 ms) allow at most 909 Hz."""
SEARCH_S = 30.0


class MeasuringHub(Hub):
    """A hub that sends its SYNC arrivals over `connection` whenever a sender of SYNC leaves."""

    def __init__(self, connection: Connection, period_ns: int) -> None:
        super().__init__("127.0.0.1", 0)
        self._connection, self._period_ns = connection, period_ns
        self._intervals = SyncIntervals(period_ns)
        connection.send(self.address[1])

    def poll(self, timeout_s: float) -> list[Event]:
        events = super().poll(timeout_s)
        now_ns = time.monotonic_ns()
        for event in events:
            if type(event) is Received:
                if event.frame.can_id == Cob.SYNC:
                    self._intervals.note(now_ns)
            elif type(event) is Detached and event.channel == "can0" and self._intervals.count:
                self._connection.send(self._intervals.summary())
                self._intervals = SyncIntervals(self._period_ns)
        return events


@contextlib.contextmanager
def _in_class(realtime: bool) -> Iterator[bool]:
    """SCHED_FIFO for this thread, if `realtime`; False if that is refused."""
    if not realtime:
        yield True
        return
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except (AttributeError, OSError):
        yield False
        return
    try:
        yield True
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _serve_bare(connection: Connection, cell: Cell, realtime: bool) -> None:
    hub = MeasuringHub(connection, cell.bus.cycle_ns)
    with _in_class(realtime):
        while True:
            hub.poll(1.0)


def _serve_emulator(connection: Connection, cell: Cell, realtime: bool) -> None:
    bench = make_bench(cell, {}, Clock.WALL, 0)
    runner = EmulatorRunner(bench, MeasuringHub(connection, cell.bus.cycle_ns))
    with _in_class(realtime):
        runner.run()


class Server:
    """A process that serves the bus."""

    def __init__(self, target: Callable[[Connection, Cell, bool], None], cell: Cell, realtime: bool) -> None:
        self._connection, theirs = multiprocessing.Pipe()
        self._process = multiprocessing.Process(target=target, args=(theirs, cell, realtime), daemon=True)
        self._process.start()
        self.port: int = self._connection.recv()

    def arrival(self) -> dict[str, Any]:
        """The arrivals of the last sender of SYNC."""
        return dict(self._connection.recv())

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, *exception: object) -> None:
        self._process.terminate()
        self._process.join()


def _bare_block(server: Server, cell: Cell) -> dict[str, Any]:
    """SYNC at absolute deadlines; missed deadlines are skipped, as our controller does."""
    period_ns = cell.bus.cycle_ns
    frames = (sync_frame(None),)
    with open_port("canarm", "can0", host="127.0.0.1", port=server.port) as port:
        next_ns = time.monotonic_ns()
        for _ in range(CYCLES):
            next_ns += period_ns
            left_ns = next_ns - time.monotonic_ns()
            if left_ns > 0:
                time.sleep(left_ns * 1e-9)
            else:
                next_ns += -left_ns // period_ns * period_ns
            port.send(frames)
    return server.arrival()


def _controlled_block(
    server: Server, cell: Cell, cycles: int, stop_at_a_miss: bool = False
) -> tuple[dict[str, Any], RunResult]:
    """A run of our controller, with its reports on the bench bus."""
    controller = make_controller(cell, "mras", "sine", None, Clock.WALL, cycles)
    options = {"host": "127.0.0.1", "port": server.port}
    with open_port("canarm", "can0", **options) as port, open_port("canarm", "bench", **options) as bench:
        runner = Runner(controller, port, bench)
        if stop_at_a_miss:
            runner = Runner(controller, port, bench, should_stop=lambda: "missed" if runner.missed else None)
        result = runner.run()
    return server.arrival(), result


def _highest_rate(realtime: bool) -> tuple[int, str]:
    """The highest of `RATES_HZ` that ran without a miss (0: none), and what happened at the next."""
    low, high, remark = 0, len(RATES_HZ), "no faster one was tried"
    while low < high:
        middle = (low + high) // 2
        rate_hz = RATES_HZ[middle]
        nominal = load_cell("konkuk1")
        cell = nominal.model_copy(update={"bus": nominal.bus.model_copy(update={"cycle_us": 1_000_000 // rate_hz})})
        with Server(_serve_emulator, cell, realtime) as server, _in_class(realtime):
            _, result = _controlled_block(server, cell, round(SEARCH_S * rate_hz), stop_at_a_miss=True)
        if result.state is State.DONE and not result.missed:
            low = middle + 1
        else:
            high = middle
            remark = f"{rate_hz} Hz missed its first cycle after {result.ticks / rate_hz:.1f} s"
    return (RATES_HZ[low - 1] if low else 0), remark


def _described(blocks: list[dict[str, Any]]) -> str:
    jitter = [block["jitter"] for block in blocks]
    tails = [statistics.median(block[name] for block in jitter) for name in ("p99_us", "p99_9_us")]
    worst_us = max(block["max_us"] for block in jitter)
    gaps = sum(block["gaps"] for block in blocks)
    return f"p99 {tails[0]:.0f}, p99.9 {tails[1]:.0f}, max {worst_us:.0f} us, {gaps} SYNCs left out"


def _jitter_row(cell: Cell, realtime: bool) -> Row:
    bare, ours, missed = [], [], 0
    with Server(_serve_bare, cell, realtime) as bare_server, Server(_serve_emulator, cell, realtime) as emulator:
        for _ in range(BLOCKS):
            with _in_class(realtime):
                bare.append(_bare_block(bare_server, cell))
                arrival, result = _controlled_block(emulator, cell, CYCLES)
            ours.append(arrival)
            missed += result.missed
    ratio = Ratio.of(*([block["jitter"]["p99_us"] for block in blocks] for blocks in (ours, bare)))
    what = "the same in a real-time class" if realtime else "SYNC arrival jitter at 400 Hz, p99"
    remark = f"ours: {_described(ours)}, {missed} cycles missed; bare: {_described(bare)}; {_load()}"
    return Row(what, "bare absolute-sleep loop", ratio, "" if realtime else "<= 1.5", remark)


def _load() -> str:
    return f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "load not known"


def rows() -> list[Row]:
    """The rows of the table."""
    cell = load_cell("konkuk1")
    with _in_class(True) as may_be_realtime:
        pass
    found = [_jitter_row(cell, realtime) for realtime in (False, True)[: 1 + may_be_realtime]]
    rate_hz, remark = _highest_rate(may_be_realtime)
    in_class = "in a real-time class" if may_be_realtime else "without a real-time class"
    rate = Ratio.of([rate_hz], [1.0 / cell.bus.cycle_s])
    what = f"highest rate without a miss in {SEARCH_S:.0f} s"
    return [*found, Row(what, "400 Hz", rate, "", f"{rate_hz} Hz, {in_class}; {remark}; {_load()}")]
