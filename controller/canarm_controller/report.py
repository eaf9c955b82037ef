"""What the controller tells the test bench: reference of every tick, and now and then what it measured and thinks.

The robot needs none of it; it travels on the bench bus, in batches, and is judged there.
"""

from canarm_protocol.bench_objects import INTERNALS, bench_pdos
from canarm_protocol.cell import Cell
from canarm_protocol.frames import Frame

from .controller import Controller

BATCH_TICKS = 16
"""Ticks whose frames go out together: 40 ms at 2.5 ms."""
DETAIL_TICKS = 8
"""Every how many ticks measurements, commands and internals are reported: 50 Hz at 2.5 ms."""


class BenchReport:
    """Gathers the frames of a run; `take` hands them over when a batch is full."""

    def __init__(self, cell: Cell, controller: Controller) -> None:
        self._controller = controller
        self._pdos = bench_pdos(cell)
        self._frames: list[Frame] = []
        self._joints = range(len(cell.joints))

    def tick(self) -> None:
        """Report the tick that has just been controlled."""
        cycle, pdos, frames = self._controller.loop.cycle, self._pdos, self._frames
        tick = cycle.tick
        for layout, angle in zip(pdos.reference, cycle.reference_rad, strict=True):
            frames.append(Frame(layout.cob_id, layout.pack(tick, angle)))
        if tick % DETAIL_TICKS == 0:
            self._details()

    def take(self, everything: bool = False) -> list[Frame]:
        """The frames of a full batch, or none; with `everything` whatever there is, the controller's state with it."""
        if everything:
            self._state()
        elif len(self._frames) < BATCH_TICKS * len(self._joints):
            return []
        frames, self._frames = self._frames, []
        return frames

    def _details(self) -> None:
        loop, pdos, frames = self._controller.loop, self._pdos, self._frames
        cycle = loop.cycle
        internals = list(loop.internals().values())[:INTERNALS]
        for joint in self._joints:
            measured, command = pdos.measured[joint], pdos.command[joint]
            frames.append(
                Frame(measured.cob_id, measured.pack(cycle.position_rad[joint], cycle.velocity_rad_s[joint]))
            )
            current = cycle.applied_nm[joint] / loop.arm.torque_per_ampere[joint]
            frames.append(Frame(command.cob_id, command.pack(current, cycle.feedforward_nm[joint])))
            values = [values[joint] for values in internals] + [0.0] * (INTERNALS - len(internals))
            for layout, pair in zip(pdos.internals[joint], (values[:2], values[2:]), strict=True):
                frames.append(Frame(layout.cob_id, layout.pack(*pair)))
        self._state()

    def _state(self) -> None:
        controller, layout = self._controller, self._pdos.controller
        late = min(controller.missed, 0xFFFF)
        self._frames.append(Frame(layout.cob_id, layout.pack(max(controller.tick, 0), late, controller.state)))

