"""Draw the dashboard for the README: docs/pictures/dashboard.svg, 120 x 36, the same bytes every time.

A synthetic run and a clock that stands still feed it, so that the picture changes only when the dashboard does.
"""

import asyncio
from pathlib import Path

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.transport.port import BusPort, Discarded
from canarm_tui import DashboardApp
from canarm_tui.synthetic import SyntheticBench

PICTURE = Path(__file__).parent.parent / "docs" / "pictures" / "dashboard.svg"
SIZE = (120, 36)
SECONDS = 12
DRAINS_PER_SECOND = 20


class SyntheticPort(BusPort):
    """Gives what `SyntheticBench` sent between two drains."""

    def __init__(self, bench: SyntheticBench, cycles_a_drain: int) -> None:
        self.description = "-i canarm -c bench"
        self.discarded = Discarded()
        self._bench, self._step = bench, cycles_a_drain
        self._cycle = 0
        self._is_drained = True

    def advance(self) -> None:
        self._is_drained = False

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        if self._is_drained:
            return []
        self._is_drained = True
        first, self._cycle = self._cycle, self._cycle + self._step
        return [item for cycle in range(first, self._cycle) for item in self._bench.frames(cycle)]

    def send(self, frames: list[Frame]) -> None:
        pass

    def fileno(self) -> None:
        return None

    def close(self) -> None:
        pass


async def draw() -> str:
    cell = load_cell("konkuk1")
    period_ns = 1_000_000_000 // DRAINS_PER_SECOND
    port = SyntheticPort(SyntheticBench(cell), period_ns // cell.bus.cycle_ns)
    now_ns = 0
    app = DashboardApp(cell, lambda: port, clock_ns=lambda: now_ns, in_background=lambda job: job())
    async with app.run_test(size=SIZE) as pilot:
        for _ in range(SECONDS * DRAINS_PER_SECOND):
            port.advance()
            now_ns += period_ns
            app.drain()
        app.redraw()
        await pilot.pause()
        return app.export_screenshot(title="canarm tui", simplify=True)


if __name__ == "__main__":
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    PICTURE.write_text(asyncio.run(draw()), encoding="utf-8")
    print(PICTURE)
