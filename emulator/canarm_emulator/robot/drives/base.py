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
    """What the drive is asked for."""
    current_a: float
    """The motor's current now."""
    time_constant_s: float
    """With which the current follows."""

    @property
    def is_on(self) -> bool:
        """Whether the motor is connected."""

    own_limited_steps: int
    """Steps so far in which the drive's own limit held the current down, the D669's for one."""
    supply_limited_steps: int
    """Steps so far in which the supply held it down."""

    @property
    def damping_nm_s(self) -> float:
        """Joint torque that the motor loses per rad/s of joint speed where the supply limits its current."""

    @property
    def refused_commands(self) -> int:
        """How often it was asked for what it never does."""

    def change(self, truth: JointTruth) -> None:
        """Motor and supply are others from now on; the current goes on from where it is."""

    def take(self, command: Command, value: float) -> None:
        """A card's output has changed. Raises `ValueError` for a value that no card gives."""

    def set_supply(self, is_on: bool) -> None:
        """Close or open the supply; open, the current decays."""

    def distort(self, stage: str, distortion: Distortion | None) -> None:
        """Change what flows at one of its stages, or no longer (None), from the next refresh on."""

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
    """Those of a joint's drive, along the signal path."""


def decay_over(step_s: float, time_constant_s: float) -> tuple[float, float]:
    """What is left of a deviation after `step_s`, and its mean over the step: e^{−h/τ} and (1 − e^{−h/τ})·τ/h."""
    ratio = step_s / time_constant_s
    return math.exp(-ratio), -math.expm1(-ratio) / ratio
