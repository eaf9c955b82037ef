"""From the DAC's output to motor torque: op-amp, D669 current amplifier, bridge, winding.

Owns the electrical state of one joint's drive. Knows nothing of the arm: the motor's speed is handed in.
"""

import math

from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.model import Command, Joint

from ...signals import Distortion
from ..joint_truth import JointTruth
from ..stages import Stage
from .base import DriveKind

DAC_FULL_SCALE = 255 / 256
"""DAC0808 output at code 255, as a fraction of I_ref (data sheet); the op-amp is trimmed to full scale there."""


OPAMP, CURRENT = "opamp", "amplifier.current"
"""Its stages at which faults act, as their taps are called."""

SURELY = 1.0 - 1e-9
"""Share of the supply below which rounding does not decide whether it gives a current."""

_CURRENT = Command.CURRENT  # looking it up is slow
_SIGN: dict[int, int] = {
    DirectionBits.OFF: 0,
    DirectionBits.CLOCKWISE: -1,
    DirectionBits.COUNTER_CLOCKWISE: 1,
    DirectionBits.ILLEGAL: 0,
}


class D669Drive:
    """Amplifier, bridge and motor winding of one joint.

    Currents have the sign of the joint torque: a reversed motor or gear shows in what the direction bits mean.
    The D669 stage is one NPN transistor in series with the motor, so along the bridge's direction it regulates
    0 ≤ i ≤ (V_supply − e)/R, with e the back-EMF counted positive along that direction. Motoring (e > 0) lowers the
    limit, braking (e < 0) raises it, and beyond no-load speed (e > V_supply) no current flows. The current follows with
    the winding's time constant L/R. It has the sign of the joint torque that it makes.
    """

    __slots__ = (
        "_back_emf_v_s_rad",
        "_braking_nm_s",
        "_dac_fraction",
        "_direction",
        "_distort_current",
        "_distort_opamp",
        "_free_rad_s",
        "_is_at_limit",
        "_joint",
        "_max_current_a",
        "_sign",
        "_supply_is_on",
        "_supply_v",
        "_torque_nm_a",
        "_winding_ohm",
        "command_a",
        "current_a",
        "illegal_directions",
        "own_limited_steps",
        "supply_limited_steps",
        "target_a",
        "time_constant_s",
    )

    def __init__(self, joint: Joint, truth: JointTruth) -> None:
        self._joint = joint
        self._direction = joint.motor.direction
        self._max_current_a = joint.drive.max_current_a
        self._supply_is_on = True
        self._dac_fraction = 0.0
        self._sign = 0
        self._distort_opamp: Distortion | None = None
        self._distort_current: Distortion | None = None
        self.command_a = 0.0
        """Signed current that amplifier and bridge command."""
        self._is_at_limit = False
        self._free_rad_s = 0.0
        """Up to this speed of the motor, either way, the supply gives the current that is commanded."""
        self.change(truth)
        self.current_a = 0.0
        """Signed motor current now."""
        self.target_a = 0.0
        """Signed current that the winding's current approached in the last step."""
        self.own_limited_steps = 0
        self.supply_limited_steps = 0
        self.illegal_directions = 0

    def change(self, truth: JointTruth) -> None:
        """Change motor and supply from now on; the current continues from its present value."""
        motor, turns = self._joint.motor, 1.0 - truth.shorted_turns
        self._back_emf_v_s_rad = truth.torque_constant_nm_a * abs(motor.gear_ratio)  # K_e = K_t in SI units
        self._torque_nm_a = self._back_emf_v_s_rad * motor.gear_efficiency
        # Shorted turns are a loop of their own: s·e drives e/R through s·R, which brakes with s·K_I·e/R.
        self._braking_nm_s = truth.shorted_turns * self._torque_nm_a * self._back_emf_v_s_rad / truth.winding_ohm
        # Of the others, N in number, K_I ∝ N, K_e ∝ N, R ∝ N and L ∝ N².
        self._torque_nm_a *= turns
        self._back_emf_v_s_rad *= turns
        self._winding_ohm = truth.winding_ohm * turns
        self._supply_v = truth.supply_v
        self.time_constant_s = motor.winding_mh * 1e-3 / truth.winding_ohm * turns
        self._bound()

    @property
    def torque_nm_a(self) -> float:
        """K_I: joint torque per ampere that the amplifier drives, N·m/A."""
        return self._torque_nm_a

    @property
    def is_on(self) -> bool:
        """Whether the bridge connects the motor."""
        return self._sign != 0 and self._supply_is_on

    @property
    def damping_nm_s(self) -> float:
        """K_I·K_e/R, and what shorted turns brake, N·m·s."""
        return self._torque_nm_a * self._back_emf_v_s_rad / self._winding_ohm + self._braking_nm_s

    @property
    def refused_commands(self) -> int:
        """How often the latch asked for 0b11."""
        return self.illegal_directions

    def take(self, command: Command, value: float) -> None:
        """The DAC's output (I_out/I_ref), or the latch's bits."""
        if command is _CURRENT:
            self._dac_fraction = value
            self.refresh_command()
        else:
            self.set_direction(int(value))

    def set_dac_output(self, fraction: float) -> None:
        """DAC output I_out/I_ref, 0 to 255/256. The op-amp and the D669 saturate outside their range."""
        self._dac_fraction = fraction
        self.refresh_command()

    def set_direction(self, bits: int) -> None:
        """Latch bits, a `DirectionBits`; 0b11 opens the bridge and is counted. Raises `ValueError` outside 0..3."""
        if bits not in _SIGN:
            raise ValueError(f"direction bits {bits}: must be 0 to 3")
        if bits == DirectionBits.ILLEGAL:
            self.illegal_directions += 1
        self._sign = self._direction * _SIGN[bits]
        self.refresh_command()

    def set_supply(self, is_on: bool) -> None:
        """Close or open the amplifier's supply; open, the current decays as with the bridge off."""
        self._supply_is_on = is_on
        self.refresh_command()

    def distort(self, stage: str, distortion: Distortion | None) -> None:
        """At OPAMP its voltage (V, 0 to opamp_full_scale_v); at CURRENT what the D669 stage regulates to (A)."""
        if stage == OPAMP:
            self._distort_opamp = distortion
        else:
            self._distort_current = distortion

    def step(self, motor_speed_rad_s: float, decay: float, mean_weight: float) -> float:
        """Advance the current by one step and return the mean joint torque over it, N·m, shorted turns included.

        `motor_speed_rad_s` is the motor's speed seen at the joint; `decay` and `mean_weight` come from `decay_over`.
        """
        target_a = self.command_a
        if target_a != 0.0:
            if self._is_at_limit:
                self.own_limited_steps += 1
            if not -self._free_rad_s < motor_speed_rad_s < self._free_rad_s:
                target_a = self._supplied_a(target_a, motor_speed_rad_s)
        deviation_a = self.current_a - target_a
        self.target_a = target_a
        self.current_a = target_a + deviation_a * decay
        torque_nm = self._torque_nm_a * (target_a + deviation_a * mean_weight)
        return torque_nm - self._braking_nm_s * motor_speed_rad_s

    def _supplied_a(self, target_a: float, motor_speed_rad_s: float) -> float:
        """What the supply gives of a commanded current at a speed of the motor."""
        back_emf_v = self._back_emf_v_s_rad * motor_speed_rad_s
        if target_a > 0.0:
            limit_a = (self._supply_v - back_emf_v) / self._winding_ohm
            if target_a > limit_a:
                self.supply_limited_steps += 1
                return limit_a if limit_a > 0.0 else 0.0
        else:
            limit_a = (self._supply_v + back_emf_v) / self._winding_ohm
            if -target_a > limit_a:
                self.supply_limited_steps += 1
                return -limit_a if limit_a > 0.0 else 0.0
        return target_a

    def _bound(self) -> None:
        """What holds for as long as the command and the motor are as they are."""
        magnitude_a = abs(self.command_a)
        self._is_at_limit = magnitude_a >= self._max_current_a
        left_v = SURELY * self._supply_v - magnitude_a * self._winding_ohm
        self._free_rad_s = left_v / self._back_emf_v_s_rad if self._back_emf_v_s_rad > 0.0 else 0.0

    def current_after(self, elapsed_s: float, old_current_a: float) -> float:
        """Signed current `elapsed_s` into the last step, which began at `old_current_a`."""
        return self.target_a + (old_current_a - self.target_a) * math.exp(-elapsed_s / self.time_constant_s)

    def refresh_command(self) -> None:
        """Work out the command: from the DAC's output through op-amp and D669 stage to the bridge."""
        if not (self._sign and self._supply_is_on):
            self.command_a = 0.0
            self._is_at_limit = False
            return
        # The op-amp's full-scale voltage cancels: the D669 stage gives max_current_a there.
        of_full_scale = self._dac_fraction / DAC_FULL_SCALE
        if not 0.0 <= of_full_scale <= 1.0:
            of_full_scale = 0.0 if of_full_scale < 0.0 else 1.0
        if self._distort_opamp is not None:
            full_scale_v = self._joint.drive.opamp_full_scale_v
            of_full_scale = self._distort_opamp(of_full_scale * full_scale_v) / full_scale_v
        magnitude_a = self._max_current_a * of_full_scale
        if self._distort_current is not None:
            magnitude_a = self._distort_current(magnitude_a)
        self.command_a = self._sign * magnitude_a
        self._bound()


def _stages(joint: Joint) -> tuple[Stage, ...]:
    drive = joint.drive
    return (
        Stage(OPAMP, "op-amp's output", "V", drive.opamp_full_scale_v),
        Stage(CURRENT, "magnitude of the current that the amplifier is asked for", "A", drive.max_current_a),
    )


D669 = DriveKind(D669Drive, _stages)
