"""Model reference adaptive control by Lyapunov's second method, joint by joint, with a bias term."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from canarm_protocol.cell.model import Control, MrasLyapunovGains
from canarm_protocol.compiling import mypyc_attr

from ..dynamics import Arm
from ..errors import LawError
from ..estimation.arm_model import arm_model
from ..estimation.observer import ArmState
from .base import ControlLaw, Cycle
from .error_weights import error_weights
from .standing import StandingHold

LOWEST, HIGHEST = 0.35, 3.0
"""Kp and Kv are projected into [LOWEST, HIGHEST] times their nominal values."""


@mypyc_attr(allow_interpreted_subclasses=True)
class MrasLyapunov(ControlLaw):
    """A reference model for each joint; the gains that adapt to it are those of the feedback itself.

    Model       a·ÿ + b·ẏ + y = r,  a = 1/ωn², b = 2ζ/ωn,  r = a·q̈_d + b·q̇_d + q_d, so that y follows q_d exactly
    Torque      τ = K_I·(Kp·(r - x) - Kv·ẋ + d̂) + feed-forward without J·q̈_d, which r supplies already
    Nominal     Kp0 = J/(a·K_I), Kv0 = b·Kp0, J the nominal effective inertia
    Error       e = y - x, z = p12·e + p22·ė (`error_weights`)
    Adaptation  K̇p = γ1·z·(r - x) - σ·(Kp - Kp0),  K̇v = -γ2·z·ẋ - σ·(Kv - Kv0),  d̂' = γ3·z, |d̂| <= limit

    P solves the model's Lyapunov equation AᵀP + PA = -diag(q1, q2). With V = eᵀPe + (K_I/J)·Σ(gain error)²/γ every
    cross term cancels and V̇ = -eᵀQe for σ = 0, whatever constant gains the joint would need and whatever constant
    torque acts on it. The other joint's inertia and Coriolis torques are not constant: they are disturbances, left to
    the feed-forward. Unlike `mras`, no sensitivity filters; stable at any γ in continuous time.

    Semi-implicit Euler; Kp and Kv keep to [0.35, 3] times nominal; all three stand still while the amplifier saturates
    and while the torque is held at rest (`standing`). State and reference are those of the observer, one cycle ahead
    (`observer.ArmState`). The first torque after `start` is the feed-forward alone: the model starts on the measured
    state.

    Gains (`control.mras_lyapunov` of the cell), figures for konkuk1 at 2.5 ms:

    - `gamma_bias` γ3 does the work: at a true joint3.mass of +50 % 20 leaves 0.37 LSB, 60 leaves 0.15, 200 leaves 0.08.
      At 500 the loop still stands, but swings with one more cycle of delay (0.5 LSB, bounded by the limit).
    - `gamma_position` γ1 and `gamma_velocity` γ2 change the error at +50 % by less than 2 %: what is wrong there is a
      weight, which no gain can carry. A hundred times as much makes it worse (0.18).

    Source: Parks, IEEE Trans. Automatic Control 11 (1966) 362-367; σ: Ioannou and Kokotović, Automatica 20 (1984)
    583-594.
    """

    name: ClassVar[str] = "mras-lyapunov"
    following_error_lsb: ClassVar[float] = 3.0
    default_feedforward: ClassVar[Literal["none", "table", "online"]] = "table"
    feedforward_excludes_inertia: ClassVar[bool] = True

    def __init__(self, arm: Arm, control: Control, period_s: float) -> None:
        """Raises `LawError` if the cell has no `[control.mras_lyapunov]`."""
        gains = control.mras_lyapunov
        if gains is None:
            raise LawError(
                "law 'mras-lyapunov': the cell has no [control.mras_lyapunov]; give its gains as konkuk1 does"
            )
        own = [control.of_joint(name) for name in arm.joint_names]
        self._joints = [
            _JointLyapunov(inertia, torque_per_ampere, its, its.mras_lyapunov or gains, period_s)
            for inertia, torque_per_ampere, its in zip(arm.effective_inertia, arm.torque_per_ampere, own, strict=True)
        ]
        self._model = arm_model(arm)
        self._state = ArmState(control.observer, period_s, arm.joint_count)
        self._standing = StandingHold(control.standing_band_rad, arm.joint_count)
        self._rate_weights = [2.0 * its.damping_ratio / its.natural_frequency_rad_s for its in own]

    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        """Model on the measured state, gains nominal, bias zero: the first torque is the feed-forward alone."""
        self._state.start(position_rad, velocity_rad_s)
        self._standing.start()
        for joint, position, velocity in zip(self._joints, position_rad, velocity_rad_s, strict=True):
            joint.start(position, velocity)

    def shift(self, shift_rad: Sequence[float]) -> None:
        """The models' and the observer's angles are shifted."""
        self._state.shift(shift_rad)
        for joint, shift in zip(self._joints, shift_rad, strict=True):
            joint.y += shift

    def update(self, cycle: Cycle) -> Sequence[float]:
        """Torques in N·m."""
        state = self._state
        state.update(cycle, self._acceleration)
        torque_nm, deviation = [], []
        for i, joint in enumerate(self._joints):
            wanted, position, velocity = state.reference_rad[i], state.position_rad[i], state.velocity_rad_s[i]
            speed = state.reference_rad_s[i]
            is_frozen = cycle.saturated[i] or self._standing.is_held(i)
            feedback_nm = joint.update(wanted, speed, cycle.reference_rad_s2[i], position, velocity, is_frozen)
            torque_nm.append(feedback_nm + cycle.feedforward_nm[i])
            deviation.append(position - wanted + self._rate_weights[i] * (velocity - speed))
        return self._standing.apply(cycle, deviation, torque_nm)

    def internals(self) -> Mapping[str, Sequence[float]]:
        """Kp (A/rad), Kv (A·s/rad), bias (A), and the model's position (rad)."""
        return {
            "kp_a_rad": [joint.kp for joint in self._joints],
            "kv_a_s_rad": [joint.kv for joint in self._joints],
            "bias_a": [joint.bias_a for joint in self._joints],
            "model_rad": [joint.y for joint in self._joints],
        }

    def _acceleration(self, q: Sequence[float], qd: Sequence[float], torque_nm: Sequence[float]) -> Sequence[float]:
        return self._model.acceleration(self._model.nominal, q, qd, torque_nm)


class _JointLyapunov:
    """One joint; names as in the equations above."""

    __slots__ = (
        "_a", "_b", "_bias_limit_a", "_gain_bias", "_gain_kp", "_gain_kv", "_kp0", "_kv0", "_leak", "_p12", "_p22",
        "_period_s", "_torque_per_ampere", "bias_a", "kp", "kv", "y", "y_rate",
    )  # fmt: skip

    def __init__(
        self, inertia: float, torque_per_ampere: float, control: Control, gains: MrasLyapunovGains, period_s: float
    ) -> None:
        omega, zeta = control.natural_frequency_rad_s, control.damping_ratio
        self._torque_per_ampere = torque_per_ampere
        self._period_s = period_s
        self._a = 1.0 / omega**2
        self._b = 2.0 * zeta / omega
        self._kp0 = inertia / (self._a * torque_per_ampere)
        self._kv0 = self._b * self._kp0
        self._gain_kp = period_s * gains.gamma_position
        self._gain_kv = period_s * gains.gamma_velocity
        self._gain_bias = period_s * gains.gamma_bias
        self._leak = period_s * gains.leakage
        self._bias_limit_a = gains.bias_limit_a
        self._p12, self._p22 = error_weights(omega, zeta)
        self.start(0.0, 0.0)

    def start(self, position_rad: float, velocity_rad_s: float) -> None:
        """Model at the measured state, gains nominal."""
        self.y, self.y_rate = position_rad, velocity_rad_s
        self.kp, self.kv, self.bias_a = self._kp0, self._kv0, 0.0

    def update(
        self,
        reference_rad: float,
        reference_rad_s: float,
        reference_rad_s2: float,
        position_rad: float,
        velocity_rad_s: float,
        is_frozen: bool,
    ) -> float:
        """Torque in N·m without feed-forward; then the step of model, Kp, Kv and bias to the next cycle."""
        a, b, period_s = self._a, self._b, self._period_s
        y, y_rate = self.y, self.y_rate
        r = a * reference_rad_s2 + b * reference_rad_s + reference_rad
        wanted = r - position_rad
        torque_nm = self._torque_per_ampere * (self.kp * wanted - self.kv * velocity_rad_s + self.bias_a)
        if not is_frozen:
            z = self._p12 * (y - position_rad) + self._p22 * (y_rate - velocity_rad_s)
            leak, kp0, kv0, limit = self._leak, self._kp0, self._kv0, self._bias_limit_a
            self.kp = _clipped(
                self.kp + self._gain_kp * z * wanted - leak * (self.kp - kp0), LOWEST * kp0, HIGHEST * kp0
            )
            self.kv = _clipped(
                self.kv - self._gain_kv * z * velocity_rad_s - leak * (self.kv - kv0), LOWEST * kv0, HIGHEST * kv0
            )
            self.bias_a = _clipped(self.bias_a + self._gain_bias * z, -limit, limit)
        self.y_rate = y_rate + period_s * (r - b * y_rate - y) / a
        self.y = y + period_s * self.y_rate
        return torque_nm


def _clipped(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value
