"""Turns the codes of a cycle into measurements, and has the arm's watch judge them.

Reactions to a verdict never enter.
"""

from collections.abc import Sequence

from canarm_protocol.cell.model import Cell, Quantity
from canarm_protocol.clock import Clock

from ..supervision.arm_watch import ArmWatch
from .loop import ControlLoop
from .safe_stop import stands_still
from .sample_times import Sample, SampleTimes

MEASURED = Quantity.POSITION, Quantity.VELOCITY, Quantity.CURRENT


class Measuring:
    """The measurements of one run: first `take`, then `judge`."""

    def __init__(self, cell: Cell, clock: Clock, loop: ControlLoop, watch: ArmWatch) -> None:
        self._loop, self._watch = loop, watch
        self._has_measured = False
        channels = [(joint, quantity) for joint in range(len(cell.joints)) for quantity in MEASURED]
        scan_ns = round(max(loop.inputs.skew_s(*channel) for channel in channels) * 1e9)
        self.times = SampleTimes(clock, cell.bus.cycle_ns, scan_ns)

    def follow(self, loop: ControlLoop, watch: ArmWatch) -> None:
        """Another loop and watch take over; the times go on."""
        self._loop, self._watch = loop, watch

    def take(self, codes: Sequence[int], tick: int) -> Sample:
        """Measure; returns what is known of the time of the samples."""
        loop = self._loop
        loop.measure(codes, tick)
        if not self._has_measured:
            self._has_measured = True
            if not stands_still(loop.cycle, self._watch.standing_rad_s):  # it still falls from the last run
                self.times.mistrust()
        sample = self.times.take()
        if sample.shift_s:
            self._watch.shift(sample.shift_s)
        return sample

    def judge(self, sample: Sample) -> None:
        """Have the watch compare the measurements with its expectations for the time of `sample`."""
        loop, inputs, watch = self._loop, self._loop.inputs, self._watch
        if sample.is_on_time:
            watch.step(loop.cycle, inputs.angle_codes, inputs.speed_codes, inputs.current_codes)
        else:
            watch.glimpse(loop.cycle, inputs.angle_codes, inputs.speed_codes, sample.excess_s, sample.is_unclear)
