"""A custom control law: PD with gravity compensation.

Run it:  canarm demo --law examples/my_law.py:MyLaw
"""

from collections.abc import Sequence

from canarm_controller.dynamics import Arm
from canarm_controller.laws import ControlLaw, Cycle
from canarm_protocol.cell import Control

STIFFNESS, DAMPING = 144.0, 24.0
"""1/s² and 1/s, times the joint's inertia: poles at 12 rad/s, critically damped."""


class MyLaw(ControlLaw):
    """τ = G(q) + J·(144·(q_d - q) + 24·(q̇_d - q̇))."""

    name = "mine"
    takes_feedforward = False  # a table would compensate the weight twice

    def __init__(self, arm: Arm, control: Control, period_s: float) -> None:
        self.arm = arm

    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        """There is no state to reset."""

    def update(self, cycle: Cycle) -> list[float]:
        """Torques in N·m."""
        torque_nm = list(self.arm.gravity(cycle.position_rad))
        for joint, inertia in enumerate(self.arm.effective_inertia):
            error = cycle.reference_rad[joint] - cycle.position_rad[joint]
            rate = cycle.reference_rad_s[joint] - cycle.velocity_rad_s[joint]
            torque_nm[joint] += inertia * (STIFFNESS * error + DAMPING * rate)
        return torque_nm
