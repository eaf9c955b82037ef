"""What the world asks of a drive, whatever its kind: torque from time and speed, and what limits the current."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from canarm_protocol.cell.model import Command, Joint

from ...signals import Distortion
from ..joint_truth import JointTruth
from ..stages import Stage


class DriveModel(Protocol):
    """Amplifier, bridge and motor winding of one joint. Currents are signed as the joint torque that they make."""

    command_a: float
    """Current that the drive is asked for."""
    current_a: float
    """The motor's current now."""
    time_constant_s: float
    """Time constant with which the current follows."""

    @property
    def is_on(self) -> bool:
        """Whether the motor is connected."""

    own_limited_steps: int
    """Steps so far in which the drive's own limit bounded the current."""
    supply_limited_steps: int
    """Steps so far in which the supply bounded it."""

    @property
    def damping_nm_s(self) -> float:
        """Joint torque that the motor loses per rad/s of joint speed where the supply limits its current."""

    @property
    def refused_commands(self) -> int:
        """How many impossible commands it has had."""

    def change(self, truth: JointTruth) -> None:
        """Change motor and supply from now on; the current continues from its present value."""

    def take(self, command: Command, value: float) -> None:
        """A card's output has changed. Raises `ValueError` for a value that no card gives."""

    def set_supply(self, is_on: bool) -> None:
        """Close or open the supply; open, the current decays."""

    def distort(self, stage: str, distortion: Distortion | None) -> None:
        """Distort the signal at one of its stages, or no longer (None), from the next refresh on."""

    def refresh_command(self) -> None:
        """Follow the inputs once more."""

    def step(self, motor_speed_rad_s: float, decay: float, mean_weight: float) -> float:
        """Advance the current by one step and return the mean joint torque over it, N·m; see `decay_over`."""

    def current_after(self, elapsed_s: float, old_current_a: float) -> float:
        """Signed current `elapsed_s` into the last step, which began at `old_current_a`."""


@dataclass(frozen=True, slots=True)
class DriveKind:
    """A kind of drive in the true robot."""

    make: Callable[[Joint, JointTruth], DriveModel]
    stages: Callable[[Joint], tuple[Stage, ...]]
    """Stages of a joint's drive along the signal path."""


def decay_over(step_s: float, time_constant_s: float) -> tuple[float, float]:
    """Remainder of a deviation after `step_s`, and its mean over the step: e^{−h/τ} and (1 − e^{−h/τ})·τ/h."""
    ratio = step_s / time_constant_s
    return math.exp(-ratio), -math.expm1(-ratio) / ratio
