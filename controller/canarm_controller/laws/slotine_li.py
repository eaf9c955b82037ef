"""Adaptive control of the whole arm after Slotine and Li: inertias, weights and friction are learned while it moves."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from canarm_protocol.cell.model import Control
from canarm_protocol.compiling import mypyc_attr

from ..dynamics import Arm
from ..errors import LawError
from ..estimation.arm_model import arm_model
from ..estimation.observer import ArmState
from .base import ControlLaw, Cycle
from .standing import StandingHold

LOWEST, HIGHEST = 0.3, 3.0
"""Every parameter is projected into [LOWEST, HIGHEST] times its nominal value."""


@mypyc_attr(allow_interpreted_subclasses=True)
class SlotineLi(ControlLaw):
    """The arm's model in the loop, linear in parameters a that adapt until the sliding variable s stays zero.

    Error       e = q - q_d,  s = ė + Λ·e,  q̇_r = q̇_d - Λ·e,  q̈_r = q̈_d - Λ·ė
    Torque      τ = Y(q, q̇, q̇_r, q̈_r)·â - K_D·s,  K_D = κ·J, J the nominal effective inertia; Λ and κ diagonal
    Adaptation  â_i = a0_i·θ_i,  θ̇_i = -γ·a0_i·(Yᵀs)_i - σ·(θ_i - 1),  that is Γ = γ·diag(a0²)

    With V = (sᵀDs + ãᵀΓ⁻¹ã)/2 and Ḋ - 2C skew-symmetric V̇ = -sᵀK_D·s for σ = 0, so s goes to zero whatever a is. That
    the parameters themselves become right takes a motion that tells them apart; tracking does not need it. Y and a are
    in `arm_model`. Friction is part of Y: the viscous part at q̇_r, Coulomb friction by the sign of q̇_d, which is free
    of noise.

    Explicit Euler with the cycle time; each θ is projected into [0.3, 3]; joint i's part of Yᵀs is left out while its
    amplifier saturates, and while its torque is held at rest (`standing`). State and reference are the observer's, one
    cycle ahead (`observer.ArmState`), whose model runs on â. The first torque after `start` is the nominal model's at
    the measured state. The feed-forward is none by default; a table would count the nominal model twice.

    Gains (`control.slotine_li` of the cell, where a joint may have a Λ and a κ of its own), figures for konkuk1 at
    2.5 ms, true joint3.mass +50 %:

    - `error_rate_rad_s` Λ and `sliding_rate_rad_s` κ make poles near √(κΛ) rad/s. 25 and 40 leave 0.05 to
      0.06 LSB. From 8 and 10 (0.15) to 80 and 160 (0.04) all is calm, also with one more cycle of delay; with that
      delay 120 and 240 swing, and the amplifier saturates in most cycles (1.2).
    - `adaptation` γ: 1 leaves 0.14, 10 to 100 leave 0.05. From 1000 on parameters run from limit to limit, and only the
      projection bounds them: 0.18, with one more cycle of delay 0.5.
    - `leakage` σ pulls a parameter that nothing excites home in 1/σ s; at 0.5 the error is twice as large.

    At a payload of m3 x 3.5 the amplifier saturates and no law follows; the parameters stay bounded and recover. A
    robot without Coulomb friction swings by some 0.4 LSB at rest, where its torque is held and let go in turn.

    Source: Slotine and Li, Int. J. Robotics Research 6-3 (1987) 49-59; σ-modification: Ioannou and Kokotović,
    Automatica 20 (1984) 583-594.
    """

    name: ClassVar[str] = "slotine-li"
    following_error_lsb: ClassVar[float] = 3.0
    takes_feedforward: ClassVar[bool] = False

    def __init__(self, arm: Arm, control: Control, period_s: float) -> None:
        """Raises `LawError` if the cell has no `[control.slotine_li]`."""
        gains = control.slotine_li
        if gains is None:
            raise LawError("law 'slotine-li': the cell has no [control.slotine_li]; give its gains as konkuk1 does")
        own = [control.of_joint(name).slotine_li or gains for name in arm.joint_names]
        self._rates_rad_s = [its.error_rate_rad_s for its in own]
        self._damping_nm_s = [
            its.sliding_rate_rad_s * inertia for its, inertia in zip(own, arm.effective_inertia, strict=True)
        ]
        self._leak = period_s * gains.leakage
        self._model = arm_model(arm)
        self._rates = [period_s * gains.adaptation * nominal for nominal in self._model.nominal]
        self._state = ArmState(control.observer, period_s, arm.joint_count)
        self._standing = StandingHold(control.standing_band_rad, arm.joint_count)
        self.sliding_rad_s: Sequence[float] = ()
        self.factors: list[float] = []
        self._parameters: list[float] = []
        self._restart_parameters()

    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        """Nominal parameters, observer at the measured state."""
        self._state.start(position_rad, velocity_rad_s)
        self._standing.start()
        self._restart_parameters()

    def shift(self, shift_rad: Sequence[float]) -> None:
        """The observer's angles are shifted."""
        self._state.shift(shift_rad)

    def update(self, cycle: Cycle) -> Sequence[float]:
        """Torques in N·m; then the step of the parameters to the next cycle."""
        state = self._state
        state.update(cycle, self._acceleration)
        q, qd, speeds = state.position_rad, state.velocity_rad_s, state.reference_rad_s
        sliding: list[float] = []
        reference_rad_s: list[float] = []
        reference_rad_s2: list[float] = []
        deviation_rad: list[float] = []
        for angle, speed, wanted, wanted_speed, change, rate in zip(
            q, qd, state.reference_rad, speeds, cycle.reference_rad_s2, self._rates_rad_s, strict=True
        ):
            error, slope = angle - wanted, speed - wanted_speed
            s = slope + rate * error
            sliding.append(s)
            reference_rad_s.append(wanted_speed - rate * error)
            reference_rad_s2.append(change - rate * slope)
            deviation_rad.append(s / rate)
        self.sliding_rad_s = sliding
        model = self._model.at(q, qd, reference_rad_s, reference_rad_s2, speeds)
        torque_nm: list[float] = []
        for modelled, damping, s, ahead in zip(
            model.torque_nm(self._parameters), self._damping_nm_s, sliding, cycle.feedforward_nm, strict=True
        ):
            torque_nm.append(modelled - damping * s + ahead)
        standing = self._standing
        commanded_nm = standing.apply(cycle, deviation_rad, torque_nm)
        for joint, is_saturated in enumerate(cycle.saturated):
            if is_saturated or standing.is_held(joint):
                sliding = [0.0 if at == joint else s for at, s in enumerate(sliding)]
        self._learn(model.gradient(sliding))
        return commanded_nm

    def internals(self) -> Mapping[str, Sequence[float]]:
        """The sliding variable (rad/s), and parameters as multiples of nominal as far as they belong to one joint."""
        return {"sliding_rad_s": list(self.sliding_rad_s), **self._model.by_joint(self.factors)}

    def _learn(self, gradient: Sequence[float]) -> None:
        leak = self._leak
        factors: list[float] = []
        parameters: list[float] = []
        for factor, rate, nominal, slope in zip(self.factors, self._rates, self._model.nominal, gradient, strict=True):
            moved = factor - rate * slope - leak * (factor - 1.0)
            if moved < LOWEST:
                moved = LOWEST
            elif moved > HIGHEST:
                moved = HIGHEST
            factors.append(moved)
            parameters.append(moved * nominal)
        self.factors, self._parameters = factors, parameters

    def _acceleration(self, q: Sequence[float], qd: Sequence[float], torque_nm: Sequence[float]) -> Sequence[float]:
        return self._model.acceleration(self._parameters, q, qd, torque_nm)

    def _restart_parameters(self) -> None:
        self.factors = [1.0] * len(self._model.nominal)
        self._parameters = list(self._model.nominal)
        self.sliding_rad_s = (0.0,) * len(self._damping_nm_s)
