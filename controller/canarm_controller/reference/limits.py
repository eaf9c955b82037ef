"""What the joints of a cell can follow, and whether a motion stays within it."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import Cell

from ..dynamics import Arm, cell_arm
from ..errors import TrajectoryError

Floats: TypeAlias = NDArray[np.float64]

CHECKED_AT_ONCE = 4096
"""Samples of a trajectory that are checked together."""
LONGEST_FIXED = 1e9


def real_numbers(values: object) -> Floats:
    """Numbers of a user, of any shape, as floats. Raises `TrajectoryError` for complex ones, else as numpy does."""
    found = np.asarray(values)
    if np.iscomplexobj(found) or (found.dtype == np.object_ and any(isinstance(each, complex) for each in found.flat)):
        raise TrajectoryError("trajectory: complex numbers; angles and times are real")
    return np.asarray(found, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Reference:
    """A stretch of trajectory, one row per tick: rad, rad/s, rad/s², each (n, joints)."""

    position_rad: Floats
    velocity_rad_s: Floats
    acceleration_rad_s2: Floats


class Sampled(Protocol):
    """What can be checked: a motion that gives its reference tick by tick."""

    def sample(self, first_tick: int, count: int, period_s: float) -> Reference:
        """The reference at `count` ticks from `first_tick` on, which are `period_s` apart."""
        ...


@dataclass(frozen=True)
class Limits:
    """What the joints can do and their sensors can see, one entry per joint, and the cycle at which it is checked.

    `arm` is the nominal model that says which current a motion takes; without one, current is not checked. Nor is its
    voltage without `supply_v`, `winding_ohm` and `back_emf_v_s_rad`.
    """

    joint_names: tuple[str, ...]
    low_deg: tuple[float, ...]
    high_deg: tuple[float, ...]
    speed_rad_s: tuple[float, ...]
    period_s: float
    is_stated: tuple[bool, ...] = ()
    """Whether the speed is the cell's `max_speed_rad_s`; else it is the tachometer's."""
    current_a: tuple[float, ...] = ()
    arm: Arm | None = None
    supply_v: tuple[float, ...] = ()
    winding_ohm: tuple[float, ...] = ()
    back_emf_v_s_rad: tuple[float, ...] = ()

    @classmethod
    def of(cls, cell: Cell) -> "Limits":
        """Joint limits, highest speeds and amplifiers of `cell`. Raises `ControllerError` for an arm without a
        model.
        """
        return cls(
            joint_names=cell.joint_names,
            low_deg=tuple(joint.limits_deg[0] for joint in cell.joints),
            high_deg=tuple(joint.limits_deg[1] for joint in cell.joints),
            speed_rad_s=tuple(joint.allowed_rad_s for joint in cell.joints),
            is_stated=tuple(joint.allowed_rad_s < joint.fastest_rad_s for joint in cell.joints),
            period_s=cell.bus.cycle_s,
            current_a=tuple(joint.drive.max_current_a for joint in cell.joints),
            arm=cell_arm(cell.laden, cell.joint_names),
            supply_v=tuple(joint.drive.supply_v for joint in cell.joints),
            winding_ohm=tuple(joint.motor.winding_ohm for joint in cell.joints),
            back_emf_v_s_rad=tuple(joint.motor.back_emf_v_s_rad for joint in cell.joints),
        )

    def check(self, trajectory: Sampled, duration_s: float, source: str) -> None:
        """Raise `TrajectoryError` at the first sample within `duration_s` that a joint cannot follow."""
        samples = int(np.ceil(duration_s / self.period_s)) + 1
        for first in range(0, samples, CHECKED_AT_ONCE):
            self._check_part(trajectory, first, min(CHECKED_AT_ONCE, samples - first), source)

    def _check_part(self, trajectory: Sampled, first: int, count: int, source: str) -> None:
        reference = trajectory.sample(first, count, self.period_s)
        position_deg = np.degrees(reference.position_rad)
        # Negated, so that NaN is found as well.
        outside = ~((position_deg >= np.array(self.low_deg)) & (position_deg <= np.array(self.high_deg)))
        too_fast = ~(np.abs(reference.velocity_rad_s) <= np.array(self.speed_rad_s))
        for sample, joint in np.argwhere(outside | too_fast)[:1].tolist():
            number = first + sample
            where = f"{source}: {self.joint_names[joint]} at sample {number} ({number * self.period_s:.4g} s)"
            if outside[sample, joint]:
                raise TrajectoryError(
                    f"{where}: {_fixed(position_deg[sample, joint], 2)} deg is outside limits_deg = "
                    f"[{self.low_deg[joint]:g}, {self.high_deg[joint]:g}]"
                )
            beyond = (
                "max_speed_rad_s of the cell" if any(self.is_stated[joint : joint + 1]) else "the tachometer's range"
            )
            raise TrajectoryError(
                f"{where}: {_fixed(reference.velocity_rad_s[sample, joint], 3)} rad/s is beyond {beyond}; "
                f"must be within +-{self.speed_rad_s[joint]:g} rad/s"
            )
        self._check_current(reference, first, source)

    def _check_current(self, reference: Reference, first: int, source: str) -> None:
        """The nominal robot must be able to follow with the current that its amplifiers have."""
        if self.arm is None:
            return
        torque_nm = self.arm.torque_batch_nm(
            reference.position_rad, reference.velocity_rad_s, reference.acceleration_rad_s2
        )
        signed_a = torque_nm / np.array(self.arm.torque_per_ampere)
        current_a = np.abs(signed_a)
        for sample, joint in np.argwhere(~(current_a <= np.array(self.current_a)))[:1].tolist():
            number = first + sample
            raise TrajectoryError(
                f"{source}: {self.joint_names[joint]} at sample {number} ({number * self.period_s:.4g} s): "
                f"{_fixed(current_a[sample, joint], 2)} A by the nominal model; "
                f"must be at most {self.current_a[joint]:g} A, all that the amplifier has"
            )
        self._check_voltage(signed_a, reference, first, source)

    def _check_voltage(self, signed_a: Floats, reference: Reference, first: int, source: str) -> None:
        """The supply must drive that current through the winding, against the back-EMF."""
        if not self.supply_v:
            return
        emf_v = np.sign(signed_a) * reference.velocity_rad_s * np.array(self.back_emf_v_s_rad)
        needed_v = np.abs(signed_a) * np.array(self.winding_ohm) + emf_v
        for sample, joint in np.argwhere(~(needed_v <= np.array(self.supply_v)))[:1].tolist():
            number = first + sample
            raise TrajectoryError(
                f"{source}: {self.joint_names[joint]} at sample {number} ({number * self.period_s:.4g} s): "
                f"{_fixed(abs(signed_a[sample, joint]), 2)} A at "
                f"{_fixed(reference.velocity_rad_s[sample, joint], 2)} rad/s take "
                f"{_fixed(needed_v[sample, joint], 1)} V, winding and back-EMF; "
                f"must be at most {self.supply_v[joint]:g} V, the supply"
            )


def _fixed(value: float, decimals: int) -> str:
    """A value with so many decimals, unless it is so absurd that these would be hundreds of digits."""
    return f"{value:.{decimals}f}" if abs(value) < LONGEST_FIXED else f"{value:.3g}"
