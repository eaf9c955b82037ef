"""Model reference adaptive control after Dubowsky and DesForges, with a bias term: the law of the KON-KUK I paper."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from canarm_protocol.cell.model import Control
from canarm_protocol.compiling import mypyc_attr

from ..dynamics import Arm
from .base import ControlLaw, Cycle
from .error_weights import error_weights

SMALLEST_AMPLITUDE_RAD = 0.1
"""A joint that moves less excites nothing to adapt to; its adaptation gains stay finite."""
LOWEST, HIGHEST = 0.35, 3.0
"""α and β are projected into [LOWEST, HIGHEST] times the model's a and b."""


@mypyc_attr(allow_interpreted_subclasses=True)
class Mras(ControlLaw):
    """A reference model for each joint, to which two gains adapt, and a bias current for what gains cannot remove.

    Model       a·ÿ + b·ẏ + y = r,  a = 1/ωn², b = 2ζ/ωn,  r = a·q̈_d + b·q̇_d + q_d, so that y follows q_d exactly
    Joint       α·ẍ + β·ẋ + x = r by feedback τ = (J/α)·(r - x) - (J·β/α)·ẋ, J the nominal effective inertia
    Error       e = y - x, ε = k1·ė + k0·e
    Adaptation  α̇ = γα·ε·(k1·u̇ + k0·u) - σ·(α - a),  a·ü + b·u̇ + u = -ÿ
                β̇ = γβ·ε·(k1·ẇ + k0·w) - σ·(β - b),  a·ẅ + b·ẇ + w = -ẏ
    Bias        d̂' = γ3·z, z = p12·e + p22·ė (`error_weights`), |d̂| <= limit
    Torque      feedback + K_I·d̂ + feed-forward without J·q̈_d, which r supplies already

    u and w are the sensitivities -∂e/∂α and -∂e/∂β of the model, so α and β go down the gradient of ε²/2. Integration
    is semi-implicit Euler (rates first). α and β keep to [0.35, 3] times a and b. While the amplifier saturates, α, β
    and d̂ stand still. The first torque after `start` is the feed-forward alone: the model starts on the measured state.

    Gains (`control.mras` of the cell), figures for konkuk1 at 2.5 ms with one cycle of delay:

    - `gamma_alpha`, `gamma_beta` are divided by the square of the trajectory's amplitude, because ε·u grows with it.
      Without bias and projection a wrong payload makes α run away from `gamma_alpha` = 0.05 on, and earlier at small
      amplitudes; with both, the RMS error at +50 % grows from 0.36 LSB at 0.02 to 0.64 at 0.2 (docs/ablation.md).
      Start at 0.02, and at ten times that for `gamma_beta`.
    - `gamma_bias`: 2ζωn·p22 = 3/2 satisfies Routh's criterion at any γ3 in continuous time; the delay does not. 20 is
      calm, 60 still gains accuracy, from 400 on the loop swings.
    - k1 (`error_rate_gain`) weighs the tachometer: 0.03 to 0.3 s differ little. σ (`leakage`) pulls α and β home when
      nothing excites them.

    α and β cannot remove a constant error such as a payload's weight, and adapting without the bias can be worse than
    not adapting. The bias brings most of the improvement at a wrong payload; α and β a further 1 to 22 %.

    Measurements are not filtered. If a joint at rest needs no torque, as when it hangs, their noise reverses the
    bridge in a quarter to half of all cycles; the joint moves by 0.1 LSB. `mras-lyapunov` holds its torque there.

    Source: Dubowsky and DesForges, J. Dynamic Systems, Measurement and Control 101 (1979) 193-200, reference [5] of the
    KON-KUK I paper. Bias: from the Lyapunov equation of the model, added here.
    """

    name: ClassVar[str] = "mras"
    following_error_lsb: ClassVar[float] = 3.0
    default_feedforward: ClassVar[Literal["none", "table", "online"]] = "table"
    feedforward_excludes_inertia: ClassVar[bool] = True

    def __init__(self, arm: Arm, control: Control, period_s: float) -> None:
        self._joints = [
            _JointMras(inertia, torque_per_ampere, control.of_joint(name), period_s)
            for name, inertia, torque_per_ampere in zip(
                arm.joint_names, arm.effective_inertia, arm.torque_per_ampere, strict=True
            )
        ]

    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        """Model on the measured state, gains nominal, bias zero: the first torque is the feed-forward alone."""
        for joint, position, velocity, amplitude in zip(
            self._joints, position_rad, velocity_rad_s, amplitude_rad, strict=True
        ):
            joint.start(position, velocity, amplitude)

    def update(self, cycle: Cycle) -> Sequence[float]:
        """Torques in N·m."""
        return [
            joint.update(
                cycle.reference_rad[i],
                cycle.reference_rad_s[i],
                cycle.reference_rad_s2[i],
                cycle.position_rad[i],
                cycle.velocity_rad_s[i],
                cycle.saturated[i],
            )
            + cycle.feedforward_nm[i]
            for i, joint in enumerate(self._joints)
        ]

    def shift(self, shift_rad: Sequence[float]) -> None:
        """The models' angles are shifted."""
        for joint, shift in zip(self._joints, shift_rad, strict=True):
            joint.y += shift

    def internals(self) -> Mapping[str, Sequence[float]]:
        """α (s²), β (s), bias (A), and the model's position (rad)."""
        return {
            "alpha": [joint.alpha for joint in self._joints],
            "beta": [joint.beta for joint in self._joints],
            "bias_a": [joint.bias_a for joint in self._joints],
            "model_rad": [joint.y for joint in self._joints],
        }


class _JointMras:
    """One joint; names as in the equations above, a trailing `_rate` for a time derivative."""

    __slots__ = (
        "_a", "_alpha_range", "_b", "_beta_range", "_bias_limit_a", "_gain_alpha", "_gain_beta", "_gain_bias", "_gains",
        "_inertia", "_k0", "_k1", "_leak", "_p12", "_p22", "_period_s", "_torque_per_ampere",
        "alpha", "beta", "bias_a", "u", "u_rate", "w", "w_rate", "y", "y_rate",
    )  # fmt: skip

    def __init__(self, inertia: float, torque_per_ampere: float, control: Control, period_s: float) -> None:
        omega, zeta = control.natural_frequency_rad_s, control.damping_ratio
        self._gains = control.mras
        self._inertia = inertia
        self._torque_per_ampere = torque_per_ampere
        self._period_s = period_s
        self._a = 1.0 / omega**2
        self._b = 2.0 * zeta / omega
        self._alpha_range = LOWEST * self._a, HIGHEST * self._a
        self._beta_range = LOWEST * self._b, HIGHEST * self._b
        self._k0 = self._gains.error_gain
        self._k1 = self._gains.error_rate_gain
        self._leak = period_s * self._gains.leakage
        self._gain_bias = period_s * self._gains.gamma_bias
        self._bias_limit_a = self._gains.bias_limit_a
        self._p12, self._p22 = error_weights(omega, zeta)
        self.start(0.0, 0.0, 0.0)

    def start(self, position_rad: float, velocity_rad_s: float, amplitude_rad: float) -> None:
        """Model at the measured state; adaptation gains for motions of `amplitude_rad`."""
        scale = self._period_s / max(amplitude_rad, SMALLEST_AMPLITUDE_RAD) ** 2
        self._gain_alpha = self._gains.gamma_alpha * scale
        self._gain_beta = self._gains.gamma_beta * scale
        self.y, self.y_rate = position_rad, velocity_rad_s
        self.u = self.u_rate = self.w = self.w_rate = 0.0
        self.alpha, self.beta, self.bias_a = self._a, self._b, 0.0

    def update(
        self,
        reference_rad: float,
        reference_rad_s: float,
        reference_rad_s2: float,
        position_rad: float,
        velocity_rad_s: float,
        saturated: bool,
    ) -> float:
        """Torque in N·m without feed-forward; then the step of model, filters, α, β and bias to the next cycle."""
        a, b, period_s = self._a, self._b, self._period_s
        y, y_rate, alpha, beta = self.y, self.y_rate, self.alpha, self.beta
        u, u_rate, w, w_rate = self.u, self.u_rate, self.w, self.w_rate

        r = a * reference_rad_s2 + b * reference_rad_s + reference_rad
        feedback_nm = self._inertia / alpha * (r - position_rad - beta * velocity_rad_s)
        torque_nm = feedback_nm + self._torque_per_ampere * self.bias_a

        y_acceleration = (r - b * y_rate - y) / a
        if not saturated:
            e, e_rate = y - position_rad, y_rate - velocity_rad_s
            k0, k1 = self._k0, self._k1
            error = k1 * e_rate + k0 * e
            leak = self._leak
            low, high = self._alpha_range
            alpha += self._gain_alpha * error * (k1 * u_rate + k0 * u) - leak * (alpha - a)
            self.alpha = low if alpha < low else high if alpha > high else alpha
            low, high = self._beta_range
            beta += self._gain_beta * error * (k1 * w_rate + k0 * w) - leak * (beta - b)
            self.beta = low if beta < low else high if beta > high else beta
            bias_a = self.bias_a + self._gain_bias * (self._p12 * e + self._p22 * e_rate)
            limit = self._bias_limit_a
            self.bias_a = -limit if bias_a < -limit else limit if bias_a > limit else bias_a

        u_rate += period_s * (-y_acceleration - b * u_rate - u) / a
        w_rate += period_s * (-y_rate - b * w_rate - w) / a
        y_rate += period_s * y_acceleration
        self.u, self.u_rate = u + period_s * u_rate, u_rate
        self.w, self.w_rate = w + period_s * w_rate, w_rate
        self.y, self.y_rate = y + period_s * y_rate, y_rate
        return torque_nm
