"""What a lap costs each robot in energy, by the nominal masses and drives of the cell `rhino-pair`.

The paths are `rhino_figures`'; text must not enter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canarm.cooperation import CooperationPlan
from canarm_controller.dynamics import nominal_arm
from canarm_protocol.cell import Cell, Robot, load_cell

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Energy:
    """Of one robot over a lap, J: what its motors do, what of it stays in friction, and what heats their windings.

    What they brake is not given back.
    """

    work_j: float
    lost_j: float
    heat_j: float


@dataclass(frozen=True)
class LapCost:
    """Both robots over a lap, and the slave's joint step over the master's: least, greatest, and where (deg)."""

    master: Energy
    slave: Energy
    least_ratio: float
    greatest_ratio: float
    greatest_at_deg: float


def cost_of(plan: CooperationPlan) -> LapCost:
    """One lap along `plan`, which ends where it began."""
    cell = _carrying(load_cell("rhino-pair"), plan.pair.carried.distance_m)
    master, slave = cell.laden
    led, followed = (np.linalg.norm(np.diff(q, axis=0), axis=1) for q in (plan.master_rad, plan.slave_rad))
    ratio = followed / led
    return LapCost(
        _energy(master, plan.time_s, plan.master_rad),
        _energy(slave, plan.time_s, plan.slave_rad),
        float(ratio.min()),
        float(ratio.max()),
        360.0 * float(np.argmax(ratio)) / len(ratio),
    )


def _carrying(cell: Cell, grasp_distance_m: float) -> Cell:
    assert cell.object is not None
    held = cell.object.model_copy(
        update={"grasp_distance_m": grasp_distance_m, "length_m": max(cell.object.length_m, grasp_distance_m)}
    )
    return cell.model_copy(update={"object": held})


def _energy(robot: Robot, time_s: Floats, q_rad: Floats) -> Energy:
    arm = nominal_arm(robot)
    speed = np.gradient(q_rad, time_s, axis=0)
    change = np.gradient(speed, time_s, axis=0)
    torque_nm = arm.torque_batch_nm(q_rad, speed, change)
    current_a = torque_nm / np.array(arm.torque_per_ampere)
    winding_ohm = np.array([joint.motor.winding_ohm for joint in robot.joint])
    power_w = torque_nm * speed
    return Energy(
        _integral(np.maximum(power_w, 0.0).sum(axis=1), time_s),
        _integral(power_w.sum(axis=1), time_s),
        _integral((winding_ohm * current_a**2).sum(axis=1), time_s),
    )


def _integral(values: Floats | Sequence[float], time_s: Floats) -> float:
    return float(np.trapezoid(values, time_s))
