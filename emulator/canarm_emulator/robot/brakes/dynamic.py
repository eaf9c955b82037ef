"""The dynamic brake: the bridge shorts the winding, and back-EMF drives a current that brakes.

With e = K_e·w the current goes to -e/(R + R_b) with the time constant L/(R + R_b), and the torque is K_I times that.
"""

import math

from canarm_protocol.cell.arm import Joint
from canarm_protocol.cell.brakes import DynamicBrake

from ..joint_truth import JointTruth
from .base import Coil


class DynamicBrakeModel:
    """A contact and a resistor across the winding."""

    friction_nm = 0.0

    __slots__ = (
        "_back_emf_v_s_rad",
        "_coil",
        "_drag",
        "_grip",
        "_joint",
        "_own_a",
        "_resistor_ohm",
        "_taken",
        "_time_constant_s",
        "_torque_nm_a",
        "_total_ohm",
        "current_a",
    )

    def __init__(self, joint: Joint, brake: DynamicBrake, truth: JointTruth) -> None:
        self._joint, self._resistor_ohm = joint, brake.resistor_ohm
        self._coil = Coil(brake.delay_ms * 1e-3, 0.0)
        self._own_a = 0.0
        """The current that back-EMF drives through the contact."""
        self.current_a = 0.0
        self.change(truth)

    def change(self, truth: JointTruth) -> None:
        """Motor or brake are others from now on; the current goes on from where it is."""
        motor, turns = self._joint.motor, 1.0 - truth.shorted_turns
        self._back_emf_v_s_rad = truth.torque_constant_nm_a * abs(motor.gear_ratio) * turns
        self._torque_nm_a = self._back_emf_v_s_rad * motor.gear_efficiency
        winding_ohm = truth.winding_ohm * turns
        self._total_ohm = winding_ohm + self._resistor_ohm
        self._taken = winding_ohm / self._total_ohm
        """Share of the amplifier's current that a closed contact bypasses around the winding."""
        self._time_constant_s = motor.winding_mh * 1e-3 * turns**2 / self._total_ohm
        self._grip = 0.0 if truth.brake_is_released else 1.0 - truth.brake_slip
        self._drag = truth.brake_drag

    @property
    def is_engaged(self) -> bool:
        """Whether its contact should be closed."""
        return self._coil.is_dead

    @property
    def damping_nm_s(self) -> float:
        """K_I·K_e/(R + R_b)."""
        return self._torque_nm_a * self._back_emf_v_s_rad / self._total_ohm

    def step(self, is_asked: bool, torque_nm: float, motor_speed_rad_s: float, step_s: float) -> float:
        """The motor's torque. A share of the contact is a contact resistance: it takes that share of all currents."""
        is_closed = self._coil.step(is_asked, step_s)
        share = max(self._grip, self._drag) if is_closed else self._drag
        if not (share or self._own_a):
            self.current_a = 0.0
            return torque_nm
        target_a = -share * self._back_emf_v_s_rad * motor_speed_rad_s / self._total_ohm
        ratio = step_s / self._time_constant_s
        deviation_a = self._own_a - target_a
        mean_a = target_a - deviation_a * math.expm1(-ratio) / ratio
        self._own_a = target_a + deviation_a * math.exp(-ratio)
        passed_by_nm = share * self._taken * torque_nm
        self.current_a = self._own_a - passed_by_nm / self._torque_nm_a
        return torque_nm - passed_by_nm + self._torque_nm_a * mean_a
