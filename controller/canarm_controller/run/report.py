"""What the controller reports to the test bench: the reference of every tick, its detections, and at intervals
measurements, commands and internals.

The robot does not need it; it goes to the bench bus in batches, and is assessed there.
"""

import math
from collections.abc import Callable

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.bench_objects import HOMING, INTERNALS, bench_pdos
from canarm_protocol.cell.model import Cell
from canarm_protocol.faults.detection_events import DetectionEvent, pieces_of

from .controller import Controller

BATCH_TICKS = 16
"""Ticks whose frames are sent together: 40 ms at 2.5 ms."""
DETAIL_TICKS = 8
"""Interval, in ticks, of measurements, commands and internals: 50 Hz at 2.5 ms."""
U16, U32 = 0xFFFF, 0xFFFF_FFFF
LARGEST = (2 - 2**-24) * 2.0**127
"""Largest number that still rounds to a finite one in single precision (IEEE 754)."""


class BenchReport:
    """Collects the frames of a run; `take` hands them over when a batch is full.

    `paced_late()` gives the number of cycles that the pacer has begun late; the bench shows them with the missed ones.
    """

    def __init__(self, cell: Cell, controller: Controller, paced_late: Callable[[], int] = lambda: 0) -> None:
        self._paced_late = paced_late
        self._controller = controller
        self._pdos = bench_pdos(cell)
        self._frames: list[Frame] = []
        self._ticks = 0
        self._told = 0
        self._joints = range(len(cell.joints))

    def tick(self) -> None:
        """Report the tick that has just been controlled."""
        cycle, pdos, frames = self._controller.loop.cycle, self._pdos, self._frames
        tick = cycle.tick
        for layout, angle in zip(pdos.reference, cycle.reference_rad, strict=True):
            frames.append(Frame(layout.cob_id, layout.pack(tick & U32, angle)))
        self._ticks += 1
        if tick % DETAIL_TICKS == 0:
            self._details()
        self._detections()

    def take(self, everything: bool = False) -> list[Frame]:
        """The frames of a batch of ticks when it is full; with `everything` whatever there is, and the state."""
        if everything:
            self._detections()
            self._state()
        elif self._ticks < BATCH_TICKS:
            return []
        self._ticks = 0
        frames, self._frames = self._frames, []
        return frames

    def _details(self) -> None:
        loop, pdos, frames = self._controller.loop, self._pdos, self._frames
        cycle = loop.cycle
        internals = list(loop.internals().values())[:INTERNALS]
        for joint in self._joints:
            measured, command = pdos.measured[joint], pdos.command[joint]
            frames.append(Frame(measured.cob_id, measured.pack(cycle.position_rad[joint], cycle.velocity_rad_s[joint])))
            current = cycle.applied_nm[joint] / loop.arm.torque_per_ampere[joint]
            frames.append(Frame(command.cob_id, command.pack(current, cycle.feedforward_nm[joint])))
            values = [_single(values[joint]) for values in internals] + [0.0] * (INTERNALS - len(internals))
            for layout, pair in zip(pdos.internals[joint], (values[:2], values[2:]), strict=True):
                frames.append(Frame(layout.cob_id, layout.pack(*pair)))
        self._state()

    def _detections(self) -> None:
        """Those that are new; the batch need not become full for them."""
        detections = self._controller.detections
        if len(detections) == self._told:
            return
        layout = self._pdos.detection
        for each in detections[self._told :]:
            event = DetectionEvent(each.tick, each.detector, each.where, each.detail, each.reaction.value)
            self._frames += (Frame(layout.cob_id, layout.pack(piece)) for piece in pieces_of(event))
            self._ticks = BATCH_TICKS
        self._told = len(detections)

    def _state(self) -> None:
        controller, layout = self._controller, self._pdos.controller
        late = min(controller.missed + self._paced_late(), U16)
        state = HOMING if controller.is_homing else controller.state
        self._frames.append(Frame(layout.cob_id, layout.pack(max(controller.tick, 0) & U32, late, state)))


def _single(value: float) -> float:
    """`value` limited to single precision: an internal value of a law may diverge."""
    return value if -LARGEST < value < LARGEST else math.copysign(math.inf, value) if value == value else math.nan
