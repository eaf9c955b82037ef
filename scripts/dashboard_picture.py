"""Draw the dashboard for the README: docs/pictures/dashboard.svg, 152 x 40, the same bytes every time.

A real bench and a real controller run in this process, in virtual time: joint2's tachometer dies, and is detected.
"""

import asyncio
from collections.abc import Sequence
from pathlib import Path

from canarm.session import make_bench, make_controller
from canarm_controller.bus.assessment import name_law
from canarm_controller.run.report import BenchReport
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell import Cell, load_cell
from canarm_protocol.cell.bench_objects import CONTROLLER_CHANNEL, DIVIDER, sdo_channel
from canarm_protocol.clock import Clock
from canarm_protocol.faults.script import parse_faults
from canarm_protocol.transport.port import BusPort, Discarded
from canarm_protocol.transport.sdo_session import SdoSession
from canarm_tui import DashboardApp

PICTURE = Path(__file__).parent.parent / "docs" / "pictures" / "dashboard.svg"
SIZE = (152, 40)
SECONDS = 8
DRAINS_PER_SECOND = 20
FAULT = """
[[set]]
name = "tachometer dies"
at = 5.0
duration = 2.0
[[set.fault]]
tap = "joint2.tachometer"
fault = "stuck"
value = 2.5
"""


class LivePort(BusPort):
    """The bench bus of a run in this process. Requests are answered at once; time passes in `run`."""

    def __init__(self, cell: Cell) -> None:
        self.description = "-i canarm -c bench"
        self.discarded = Discarded()
        self._bench = bench = make_bench(cell, {}, Clock.SYNC, seed=0)
        self._controller = make_controller(cell, "mras", "sine", None, Clock.SYNC, ticks=SECONDS * 1000)
        self._report = BenchReport(cell, self._controller)
        self._controller.on_tick = self._on_tick
        bench.start()
        bench.inject(parse_faults(FAULT, "the picture's fault"))
        channel = sdo_channel(cell.bus.bench_node_id, CONTROLLER_CHANNEL)
        name_law(SdoSession(self, *channel), "mras", self._controller.loop.internal_names)
        self._controller.begin(0)

    def run(self, until_ns: int) -> None:
        """Let virtual time pass."""
        bench, controller = self._bench, self._controller
        while bench.time_ns < until_ns:
            frames, controller.outbox = controller.outbox, []
            if not frames and controller.deadline_ns is not None:
                controller.time_out(controller.deadline_ns)
            for frame in frames:
                bench.receive(frame, controller)
            records, bench.records = bench.records, []
            for time_ns, frame, origin in records:
                if origin is not controller:
                    controller.receive(frame, time_ns)

    def _on_tick(self) -> None:
        self._report.tick()
        for frame in self._report.take():
            self._bench.receive_bench(frame, self._controller)
        if self._bench.cycle % DIVIDER == 0:
            self._bench.send_telemetry()

    def send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self._bench.receive_bench(frame, self)

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        records, self._bench.bench_records = self._bench.bench_records, []
        return [(each.time_ns, each.frame) for each in records if each.origin is not self]

    def fileno(self) -> None:
        return None

    def close(self) -> None:
        pass


async def draw() -> str:
    cell = load_cell("konkuk1")
    period_ns = 1_000_000_000 // DRAINS_PER_SECOND
    port = LivePort(cell)
    now_ns = 0
    app = DashboardApp(cell, lambda: port, clock_ns=lambda: now_ns, in_background=lambda job: job())
    async with app.run_test(size=SIZE) as pilot:
        for _ in range(SECONDS * DRAINS_PER_SECOND):
            now_ns += period_ns
            port.run(now_ns)
            app.drain()
        app.redraw()
        await pilot.pause()
        while not app.query("FooterKey"):  # they come in their own time
            await pilot.pause()
        await pilot.pause()
        return app.export_screenshot(title="canarm tui", simplify=True)


if __name__ == "__main__":
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    PICTURE.write_text(asyncio.run(draw()), encoding="utf-8")
    print(PICTURE)
