"""A plan: ten joint paths and what is known of them. How it is found is for `planning`."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np

from ..errors import CooperationError
from .carrying import ArmPair
from .compliance import Posture
from .kinematics import Floats, forward, least_singular_value_m


@dataclass(frozen=True, slots=True)
class PlanChecks:
    """What a plan keeps, all taken from its joint angles by forward kinematics; the greatest along the path.

    - `path_error_m`: the master's tip from its target;
    - `grasp_error_m`: the distance of the two tips from the grasp distance;
    - `point_error_m`: the slave's tip from B;
    - `perpendicular_error`: |a_s·a_o|, and `normal_error`: ‖n_s − s₃·a_o‖, of Definition 1 put right;
    - `master_step_rad`, `slave_step_rad`: the largest step of a joint from one pose to the next;
    - `least_singular_value_m`: the least σ_min of the master's Jacobian.
    """

    path_error_m: float
    grasp_error_m: float
    point_error_m: float
    perpendicular_error: float
    normal_error: float
    master_step_rad: float
    slave_step_rad: float
    least_singular_value_m: float


@dataclass(frozen=True, slots=True, eq=False)
class CooperationPlan:
    """Ten joint paths: `master_rad` and `slave_rad` (n, 5) at `time_s` (n,).

    `target_m` (n, 3) is the path of A and `object_frame` (n, 4, 4) o*, both in the master's base. `posture` has the s₂
    that was taken.
    """

    pair: ArmPair
    posture: Posture
    time_s: Floats
    target_m: Floats
    master_rad: Floats
    slave_rad: Floats
    object_frame: Floats

    @property
    def joint_rad(self) -> Floats:
        """All ten, the master's first: (n, 10)."""
        return np.concatenate([self.master_rad, self.slave_rad], axis=1)

    def slave_tip(self) -> Floats:
        """The slave's tip in the master's base, from its joint angles: (n, 4, 4)."""
        return np.asarray(self.pair.base_transform @ forward(self.pair.slave, self.slave_rad))

    @property
    def travel_rad(self) -> tuple[float, float]:
        """How far master and slave move, as lengths of their joint paths Σ‖Δθ‖, rad."""
        return float(travel_rad(self.master_rad)), float(travel_rad(self.slave_rad))

    @property
    def travel_ratio(self) -> float:
        """How much further the slave moves than the master."""
        master, slave = self.travel_rad
        return slave / master

    def checks(self) -> PlanChecks:
        """What the plan keeps, measured on its joint angles alone."""
        master, slave = forward(self.pair.master, self.master_rad), self.slave_tip()
        a_o, n_s, a_s = master[:, :3, 2], slave[:, :3, 0], slave[:, :3, 2]
        apart = _length(slave[:, :3, 3] - master[:, :3, 3])
        sigma = least_singular_value_m(self.pair.master, self.master_rad)
        return PlanChecks(
            path_error_m=float(_length(master[:, :3, 3] - self.target_m).max()),
            grasp_error_m=float(np.abs(apart - self.pair.carried.distance_m).max()),
            point_error_m=float(_length(slave[:, :3, 3] - self.object_frame[:, :3, 3]).max()),
            perpendicular_error=float(np.abs((a_s * a_o).sum(axis=1)).max()),
            normal_error=float(_length(n_s - self.posture.normal * a_o).max()),
            master_step_rad=float(np.abs(np.diff(self.master_rad, axis=0)).max()),
            slave_step_rad=float(np.abs(np.diff(self.slave_rad, axis=0)).max()),
            least_singular_value_m=float(sigma.min()),
        )

    def columns(self, names: Sequence[str] | None = None) -> dict[str, Floats]:
        """`time_s` and the ten joint paths in degrees by name, as a trajectory of a cell has them.

        `names` are the joints' in the cell, the master's first; "master_joint1_deg" and so on unless given. Raises
        `CooperationError` unless there are ten.
        """
        if names is None:
            names = [f"{robot}_joint{joint}_deg" for robot in self.pair.names for joint in range(1, 6)]
        if len(names) != 10:
            raise CooperationError(f"{len(names)} names; must be one for each of the ten joints")
        return {"time_s": self.time_s, **dict(zip(names, np.degrees(self.joint_rad).T, strict=True))}

    def write_csv(self, file: str | FilePath, names: Sequence[str] | None = None) -> None:
        """Write `columns` as a CSV file, one row a pose."""
        columns = self.columns(names)
        with FilePath(file).open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(np.column_stack(list(columns.values())).tolist())


def travel_rad(q_rad: Floats) -> Floats:
    """The length Σ‖Δθ‖ of joint paths (..., n, joints), rad."""
    return np.asarray(np.sqrt((np.diff(q_rad, axis=-2) ** 2).sum(axis=-1)).sum(axis=-1))


def _length(vectors: Floats) -> Floats:
    return np.asarray(np.sqrt((vectors**2).sum(axis=-1)))
