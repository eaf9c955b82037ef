"""The spring-applied brake: a disc on the motor's shaft that its coil lifts."""

from canarm_protocol.cell.arm import Joint
from canarm_protocol.cell.brakes import SpringBrake

from ..joint_truth import JointTruth
from .base import Coil


class SpringBrakeModel:
    """Dry friction of a stated torque, which holds what it has stopped."""

    current_a = 0.0
    damping_nm_s = 0.0

    __slots__ = ("_coil", "_drag", "_grip", "_torque_nm", "friction_nm")

    def __init__(self, joint: Joint, brake: SpringBrake, truth: JointTruth) -> None:
        of_the_motor_nm = joint.motor.torque_per_ampere * joint.drive.max_current_a
        self._torque_nm = of_the_motor_nm if brake.torque_nm is None else brake.torque_nm
        self._coil = Coil(brake.delay_ms * 1e-3, brake.release_ms * 1e-3)
        self.change(truth)

    def change(self, truth: JointTruth) -> None:
        """The brake is another one from now on."""
        self._grip = 0.0 if truth.brake_is_released else 1.0 - truth.brake_slip
        self._drag = truth.brake_drag
        self._press()

    @property
    def is_engaged(self) -> bool:
        """Whether its coil is dead."""
        return self._coil.is_dead

    def step(self, is_asked: bool, torque_nm: float, motor_speed_rad_s: float, step_s: float) -> float:
        """The motor's torque, as it was; the friction is the arm's."""
        was_dead = self._coil.is_dead
        if self._coil.step(is_asked, step_s) is not was_dead:
            self._press()
        return torque_nm

    def _press(self) -> None:
        share = max(self._grip, self._drag) if self._coil.is_dead else self._drag
        self.friction_nm = share * self._torque_nm
