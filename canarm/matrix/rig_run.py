"""One run of the matrix in this process: our controller and the bench in a rig, with or without a fault."""

from collections import deque

import numpy as np

from canarm_controller.run.state import State
from canarm_emulator.bench.bench import CycleTruth, Record
from canarm_protocol.cell.model import Cell

from ..rig.rig import Rig
from .evidence import Evidence, Motion, Notice, Received, motion_of, seen_by_controller
from .plan import INJECTED_S, OBSERVED_S, MatrixCell, Scenario


class _ObservedRig(Rig):
    """A rig that keeps the whole truth, can keep every frame, and lets time run on when the controller has ended."""

    def __init__(self, scenario: Scenario, cell: Cell, wire: bool) -> None:
        self.truths: list[CycleTruth] = []
        super().__init__(cell, scenario.law, scenario.trajectory, seed=scenario.seed, wire=wire)

    def keep_frames(self) -> None:
        """Forget the frames so far, and keep all that come."""
        self._records: deque[Record] = deque()

    def run_on(self) -> None:
        """Nobody sends SYNC any more: until after the cards' own protection has acted."""
        self._bench.run_on()

    def _keep_truth(self, truth: CycleTruth) -> None:
        self.truths.append(truth)
        super()._keep_truth(truth)


def run_in_rig(scenario: Scenario, cell: Cell, fault: MatrixCell | None, with_wire: bool = False) -> Evidence:
    """One run of `scenario`; without `fault`, the twin of those that have one.

    Raises what `Rig` raises, and `FaultError` for a fault that is refused.
    """
    wire = with_wire or (fault is not None and fault.needs_wire)
    with _ObservedRig(scenario, cell, wire) as rig:
        rig.run(seconds=INJECTED_S)
        rig.keep_frames()
        if fault is not None:
            rig.inject(fault.tap, fault.fault)
        injected_cycle = rig.controller.tick
        rig.run(seconds=OBSERVED_S)
        is_running = rig.state is State.RUNNING
        if not is_running:
            rig.run_on()
        motion = _motion(rig)
        frames = [Received(frame.time_ns * 1e-9, frame.frame) for frame in rig.frames]
        return Evidence(
            motion=motion,
            seen=seen_by_controller(cell, frames, motion.time_s),
            notices=tuple(
                Notice(each.detector, each.where or "", each.tick, each.reaction.value, each.reaction.stops)
                for each in rig.detections
            ),
            injected_cycle=rig.fault_events[0].cycle if rig.fault_events else injected_cycle,
            is_running=is_running,
        )


def false_alarms(scenario: Scenario, cell: Cell, payload_factor: float) -> list[Notice]:
    """What is noticed in a fault-free run whose last link weighs `payload_factor` times what the controller thinks.

    As long as a run with a fault. A run that ends is noticed at least by what has ended it.
    """
    truth = {f"{cell.joint_names[-1]}.mass": cell.joints[-1].mass_kg * payload_factor}
    with Rig(cell, scenario.law, scenario.trajectory, seed=scenario.seed, truth=truth) as rig:
        rig.run(seconds=INJECTED_S + OBSERVED_S)
        return [
            Notice(each.detector, each.where or "", each.tick, each.reaction.value, each.reaction.stops)
            for each in rig.detections
        ]


def _motion(rig: _ObservedRig) -> Motion:
    truths = rig.truths
    references = np.column_stack([joint.reference_rad for joint in rig.joints.values()])
    unknown = np.full((len(truths) - len(references), references.shape[1]), np.nan)
    return motion_of(
        np.array([truth.cycle for truth in truths]),
        np.array([truth.time_ns for truth in truths]) * 1e-9,
        np.array([truth.joints for truth in truths]),
        np.concatenate((references, unknown)),
    )
