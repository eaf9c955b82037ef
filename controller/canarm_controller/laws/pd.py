"""The benchmark: a fixed proportional-derivative law per joint, without adaptation."""

from collections.abc import Sequence
from typing import ClassVar

from canarm_protocol.cell.model import Control
from canarm_protocol.compiling import mypyc_attr

from ..dynamics import Arm
from .base import ControlLaw, Cycle


@mypyc_attr(allow_interpreted_subclasses=True)
class Pd(ControlLaw):
    """τ = J·ωn²·(q_d - q) + 2ζωn·J·(q̇_d - q̇) + feed-forward, J the joint's nominal effective inertia.

    Measurements are not filtered: if a joint at rest needs no torque, as when it hangs, their noise reverses the
    bridge in up to half of all cycles. With `--feedforward table` this is the paper's controller without its
    adaptation.
    """

    name: ClassVar[str] = "pd"
    following_error_lsb: ClassVar[float] = 15.0

    def __init__(self, arm: Arm, control: Control, period_s: float) -> None:
        rows = [
            (inertia, own.natural_frequency_rad_s, own.damping_ratio)
            for inertia, own in zip(arm.effective_inertia, map(control.of_joint, arm.joint_names), strict=True)
        ]
        self._stiffness_nm_rad = tuple(inertia * omega**2 for inertia, omega, _ in rows)
        self._damping_nm_s = tuple(2.0 * zeta * omega * inertia for inertia, omega, zeta in rows)

    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        """Nothing to remember."""

    def update(self, cycle: Cycle) -> Sequence[float]:
        """Torques in N·m."""
        return [
            stiffness * (wanted - position) + damping * (wanted_speed - speed) + feedforward
            for stiffness, damping, wanted, position, wanted_speed, speed, feedforward in zip(
                self._stiffness_nm_rad,
                self._damping_nm_s,
                cycle.reference_rad,
                cycle.position_rad,
                cycle.reference_rad_s,
                cycle.velocity_rad_s,
                cycle.feedforward_nm,
                strict=True,
            )
        ]
