"""One run of the matrix in this process: our controller and the bench in a rig, with or without a fault."""

import math

import numpy as np

from canarm_controller.run.state import State
from canarm_emulator.bench.bench import CycleTruth
from canarm_emulator.robot.world import JointState
from canarm_protocol.cell.model import Cell

from ..rig.kept_frames import KeptFrames
from ..rig.rig import Rig
from .evidence import Evidence, Floats, Ints, Motion, Notice, Received, inputs_of, motion_of, seen_by_controller
from .plan import OBSERVED_S, MatrixCell, Scenario

SPARE_S = 1.0
"""More than is ever observed: a history that holds it all."""


class _ObservedRig(Rig):
    """A rig that keeps the whole truth, can keep every frame, and lets time run on after the controller has ended."""

    def __init__(self, scenario: Scenario, cell: Cell, wire: bool) -> None:
        self.truths: list[CycleTruth] = []
        super().__init__(
            cell,
            scenario.law,
            scenario.trajectory,
            seed=scenario.seed,
            wire=wire,
            truth=dict(scenario.truth),
            history_s=scenario.at_s + OBSERVED_S + SPARE_S,
        )

    def keep_frames(self) -> None:
        """Forget the frames so far, and keep all from now on."""
        self._frames = KeptFrames(None)

    def run_on(self) -> None:
        """Let time run without SYNC until the cards' own protection has acted."""
        self._bench.run_on()

    def lost_by(self) -> tuple[str, ...]:
        """The hands that hold the object no longer."""
        carried = self._bench.world.object
        return () if carried is None else carried.lost

    def load_faults(self) -> None:
        """Load now what the first fault would need."""
        self._bench.load()

    def _keep_truth(self, truth: CycleTruth) -> None:
        self.truths.append(truth)
        super()._keep_truth(truth)


class AtOnset:
    """A run of `scenario` that has come to the onset without any fault: its beginning is that of all its faults.

    Raises what `Rig` raises.
    """

    def __init__(self, scenario: Scenario, cell: Cell, with_wire: bool = False) -> None:
        self._cell = cell
        self._rig = rig = _ObservedRig(scenario, cell, with_wire)
        rig.run(seconds=scenario.at_s)
        rig.keep_frames()
        self._before = _columns(rig.truths, len(rig.joints))
        rig.truths.clear()
        rig.load_faults()
        inputs_of(cell)

    def observe(self, fault: MatrixCell | None) -> Evidence:
        """Go on with `fault`, or without: then it is the twin of those that have one. It can be asked for once.

        Raises `FaultError` for a fault that is refused.
        """
        rig, cell = self._rig, self._cell
        if fault is not None:
            rig.inject(fault.tap, fault.fault)
        injected_cycle = rig.controller.tick
        rig.run(seconds=OBSERVED_S)
        is_running = rig.state is State.RUNNING
        if not is_running:
            rig.run_on()
        motion = self._motion()
        frames = [Received(frame.time_ns * 1e-9, frame.frame) for frame in rig.frames]
        return Evidence(
            motion=motion,
            seen=seen_by_controller(cell, frames, motion.time_s),
            notices=_notices(rig),
            injected_cycle=rig.fault_events[0].cycle if rig.fault_events else injected_cycle,
            is_running=is_running,
            grip_n=_grip_n(rig.truths),
            lost_by=rig.lost_by(),
        )

    def _motion(self) -> Motion:
        rig, before = self._rig, self._before
        after = _columns(rig.truths, len(rig.joints))
        cycle = np.concatenate((before[0], after[0]))
        references = np.column_stack([joint.reference_rad for joint in rig.joints.values()])
        unknown = np.full((len(cycle) - len(references), references.shape[1]), np.nan)
        return motion_of(
            cycle,
            np.concatenate((before[1], after[1])),
            np.concatenate((before[2], after[2])),
            np.concatenate((references, unknown)),
        )


def run_in_rig(scenario: Scenario, cell: Cell, fault: MatrixCell | None, with_wire: bool = False) -> Evidence:
    """One run of `scenario` from its beginning to its end. Raises what `AtOnset` and `AtOnset.observe` raise."""
    return AtOnset(scenario, cell, with_wire or (fault is not None and fault.needs_wire)).observe(fault)


def false_alarms(scenario: Scenario, cell: Cell, payload_factor: float) -> tuple[Notice, ...]:
    """What is noticed in a fault-free run whose last link weighs `payload_factor` times what the controller thinks.

    It is as long as a run with a fault. A run that stops is noticed at least by the reason of its stop.
    """
    truth: dict[str, object] = dict(scenario.truth)
    truth[f"{cell.joint_names[-1]}.mass"] = cell.joints[-1].mass_kg * payload_factor
    with Rig(cell, scenario.law, scenario.trajectory, seed=scenario.seed, truth=truth) as rig:
        rig.run(seconds=scenario.at_s + OBSERVED_S)
        return _notices(rig)


def _notices(rig: Rig) -> tuple[Notice, ...]:
    return tuple(
        Notice(each.detector, each.where or "", each.tick, each.reaction.value, each.reaction.stops)
        for each in rig.detections
    )


def _grip_n(truths: list[CycleTruth]) -> float | None:
    """The greatest force of a hand on the object, at SYNCs: its pads pass nothing on that is shorter."""
    forces_n = [
        math.hypot(*force)
        for each in truths
        if each.object
        for force in (each.object.master_force_n, each.object.slave_force_n)
    ]
    return max(forces_n, default=None)


def _columns(truths: list[CycleTruth], joints: int) -> tuple[Ints, Floats, Floats]:
    """Cycles (n,), times in s (n,), and the joints' values (n, joints, 6)."""
    shape = (len(truths), joints, len(JointState._fields))
    times_ns: Floats = np.array([truth.time_ns for truth in truths], dtype=np.float64)
    return (
        np.array([truth.cycle for truth in truths], dtype=np.int64),
        times_ns * 1e-9,
        np.array([truth.joints for truth in truths], dtype=np.float64).reshape(shape),
    )
