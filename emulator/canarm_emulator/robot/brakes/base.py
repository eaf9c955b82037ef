"""What the world asks of a brake, whatever its kind, and the coil that all of them have.

A coil is fed as long as the joint's amplifier is asked for current. So a brake engages when the controller asks for
none, when the latch or a broken wire opens the bridge, and when the supply is opened; no card has an output for it.
"""

from typing import Protocol

from ..joint_truth import JointTruth


class BrakeModel(Protocol):
    """A brake at the motor's shaft. Torques are those at the joint."""

    current_a: float
    """What it adds to the current in the motor's winding, signed as the joint torque that it makes."""
    friction_nm: float
    """Dry friction that it makes now."""

    @property
    def is_engaged(self) -> bool:
        """Whether its coil is dead, and it acts unless it is broken."""

    @property
    def damping_nm_s(self) -> float:
        """The most that it brakes per rad/s."""

    def change(self, truth: JointTruth) -> None:
        """Motor or brake are others from now on."""

    def step(self, is_asked: bool, torque_nm: float, motor_speed_rad_s: float, step_s: float) -> float:
        """Advance by one step. `is_asked` is whether the amplifier is asked for current, and `torque_nm` the mean
        torque that its current makes over the step.

        Returns the mean torque of the motor; `friction_nm` is not part of it.
        """


class Coil:
    """When a brake acts: `delay_s` after the last current was asked for, until `release_s` after the next one is.

    What is shorter than these makes no difference: a current that changes its sign passes zero. Without power at first.
    """

    __slots__ = ("_delay_s", "_other_s", "_release_s", "is_dead")

    def __init__(self, delay_s: float, release_s: float) -> None:
        self._delay_s, self._release_s = delay_s, release_s
        self.is_dead = True
        self._other_s = 0.0
        """For how long it has been asked for the other state."""

    def step(self, is_fed: bool, step_s: float) -> bool:
        """A step passes; whether the coil is dead at its end."""
        if is_fed is not self.is_dead:
            self._other_s = 0.0
            return self.is_dead
        self._other_s += step_s
        if self._other_s >= (self._release_s if is_fed else self._delay_s):
            self.is_dead, self._other_s = not self.is_dead, 0.0
        return self.is_dead
