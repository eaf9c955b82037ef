"""What a cycle costs: lockstep between two processes against the bare exchange of the same frames, and one process
alone.

The bare exchange uses the same hub, the same client and frames of the same identifiers and lengths, but answers
without a node or
a world behind them, and asks without a law: what is left is the transport. Blocks alternate, so that a change in the
machine's
speed meets both.
"""

import multiprocessing
import statistics
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection

from measure import Ratio, Row

from canarm import Rig
from canarm.session import make_bench, make_controller
from canarm_controller.run.runner import Runner
from canarm_emulator.serving.hub import Hub
from canarm_emulator.serving.hub_events import Received
from canarm_emulator.serving.runner import EmulatorRunner
from canarm_protocol.canopen.frames import Cob, Frame, sync_frame, time_frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock
from canarm_protocol.transport.port import open_port

CYCLES = 1500
BLOCKS = 9
PERIOD_S = 0.0025
OUT = (Frame(0x312, bytes(4)), Frame(0x213, bytes(1)))
BACK = (Frame(0x294, bytes(8)), Frame(0x394, bytes(4)))


def _serve_bare(connection: Connection) -> None:
    hub = Hub("127.0.0.1", 0)
    connection.send(hub.address[1])
    while True:
        for event in hub.poll(1.0):
            if isinstance(event, Received) and event.frame.can_id == Cob.SYNC:
                for frame in (*BACK, time_frame(0)):
                    hub.send(event.channel, 0, frame)
                hub.flush()


def _serve_emulator(connection: Connection) -> None:
    bench = make_bench(load_cell("konkuk1"), {}, Clock.SYNC, 0)
    hub = Hub("127.0.0.1", 0)
    connection.send(hub.address[1])
    EmulatorRunner(bench, hub).run()


def _start(target: object) -> tuple[multiprocessing.Process, int]:
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.Process(target=target, args=(theirs,), daemon=True)  # type: ignore[arg-type]
    process.start()
    return process, ours.recv()


def _bare_cycle_s(port_number: int) -> float:
    frames = (*OUT, sync_frame(1))
    with open_port("canarm", "can0", host="127.0.0.1", port=port_number) as port:
        started = time.perf_counter()
        for _ in range(CYCLES):
            port.send(frames)
            left = len(BACK) + 1
            while left:
                left -= len(port.receive(1.0))
        return (time.perf_counter() - started) / CYCLES


def _full_cycle_s(port_number: int, with_bench: bool) -> float:
    cell = load_cell("konkuk1")
    controller = make_controller(cell, "mras", "sine", None, Clock.SYNC, CYCLES)
    with open_port("canarm", "can0", host="127.0.0.1", port=port_number) as port:
        bench = open_port("canarm", "bench", host="127.0.0.1", port=port_number) if with_bench else None
        result = Runner(controller, port, bench).run()
        if bench is not None:
            bench.close()
    return PERIOD_S / result.real_time_factor


def _rig_factor() -> float:
    with Rig("konkuk1", law="mras") as rig:
        rig.run(0.1)
        started = time.process_time()
        rig.run(CYCLES * PERIOD_S)
        return CYCLES * PERIOD_S / (time.process_time() - started)


def rows() -> list[Row]:
    """The rows of the table."""
    bare_server, bare_port = _start(_serve_bare)
    emulator, emulator_port = _start(_serve_emulator)
    bare, alone, reported, rig = [], [], [], []
    try:
        for _ in range(BLOCKS):
            bare.append(_bare_cycle_s(bare_port))
            alone.append(_full_cycle_s(emulator_port, with_bench=False))
            reported.append(_full_cycle_s(emulator_port, with_bench=True))
            rig.append(_rig_factor())
    finally:
        bare_server.terminate()
        emulator.terminate()
    bare_name = "bare exchange of the same frames"
    return [
        Row("lockstep, two processes", bare_name, Ratio.of(alone, bare), "<= 2", _remark(alone)),
        Row("the same with reports on the bench bus", bare_name, Ratio.of(reported, bare), "", _remark(reported)),
        Row("one process (rig)", "real time", Ratio.of(rig, [1.0] * len(rig)), ">= 30", "time of one core"),
    ]


def _remark(cycles_s: Sequence[float]) -> str:
    cycle_s = statistics.median(cycles_s)
    return f"{cycle_s * 1e6:.0f} us a cycle, {PERIOD_S / cycle_s:.1f} x real time"
