"""Frames as a bench and a controller send them, computed from formulas instead of physics.

For pictures, measurements and tests of the dashboard without an emulator. Nothing here reads a clock or draws.
"""

import math

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.bench_objects import DIVIDER, bench_pdos
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import position_steps_rad

REFERENCE_LAG = 8
"""References come in batches of this many ticks, that much later."""
REPORT_CYCLES = 80
RUNNING = 2


class SyntheticBench:
    """A run of `cell` in which every joint swings 30 degrees about home; telemetry every `divider` cycles."""

    def __init__(self, cell: Cell, divider: int = DIVIDER) -> None:
        self._cell, self._divider = cell, divider
        self._pdos = bench_pdos(cell)
        self._lsb_rad = position_steps_rad(cell)
        self._next_tick = 0

    def reference_rad(self, joint: int, cycle: int) -> float:
        """The reference of `joint` at `cycle`."""
        return math.radians(self._cell.joints[joint].home_deg + 30.0 * math.sin(self._phase(joint, cycle)))

    def error_lsb(self, joint: int, cycle: int) -> float:
        """True minus reference angle; the first joint stays within one LSB, every further one leaves it by more."""
        phase = self._phase(joint, cycle)
        return (0.6 + 0.7 * joint) * math.sin(phase) + 0.25 * math.sin(11.0 * phase)

    def frames(self, cycle: int) -> list[tuple[int, Frame]]:
        """What goes over the bench bus at `cycle`, with its time in ns; call it for every cycle, in order."""
        time_ns, pdos = cycle * self._cell.bus.cycle_ns, self._pdos
        frames: list[Frame] = []
        if cycle % self._divider == 0:
            frames.append(Frame(pdos.status.cob_id, pdos.status.pack(cycle)))
            for joint in range(len(self._cell.joints)):
                frames += self._truth(joint, cycle)
        if cycle - self._next_tick >= REFERENCE_LAG:
            for joint, layout in enumerate(pdos.reference):
                frames += [
                    Frame(layout.cob_id, layout.pack(tick, self.reference_rad(joint, tick)))
                    for tick in range(self._next_tick, cycle)
                ]
            self._next_tick = cycle
        if cycle % REPORT_CYCLES == 0:
            frames.append(Frame(pdos.controller.cob_id, pdos.controller.pack(cycle, 0, RUNNING)))
        return [(time_ns, frame) for frame in frames]

    def _truth(self, joint: int, cycle: int) -> list[Frame]:
        truth, drive = self._pdos.truth[joint], self._pdos.drive[joint]
        limit_a = self._cell.joints[joint].drive.max_current_a
        angle = self.reference_rad(joint, cycle) + self.error_lsb(joint, cycle) * self._lsb_rad[joint]
        speed = (self.reference_rad(joint, cycle + 1) - self.reference_rad(joint, cycle)) / self._cell.bus.cycle_s
        wanted_a = 1.2 * limit_a * math.sin(self._phase(joint, cycle) + 0.4)
        command_a = max(-limit_a, min(limit_a, wanted_a))
        return [
            Frame(truth.cob_id, truth.pack(angle, speed)),
            Frame(drive.cob_id, drive.pack(0.95 * command_a, command_a)),
        ]

    def _phase(self, joint: int, cycle: int) -> float:
        return 2.0 * math.pi * 0.25 * (1.0 + 0.5 * joint) * cycle * self._cell.bus.cycle_s
