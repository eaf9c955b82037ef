"""Computed torque: the arm's nonlinear model inverted in the loop, without adaptation."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from canarm_protocol.cell.model import Control
from canarm_protocol.compiling import mypyc_attr

from ..dynamics import Arm
from ..estimation.arm_model import arm_model
from ..estimation.observer import ArmState
from .base import ControlLaw, Cycle
from .standing import StandingHold


@mypyc_attr(allow_interpreted_subclasses=True)
class ComputedTorque(ControlLaw):
    """All joints decoupled by the nominal model, so that each error obeys ë + 2ζωn·ė + ωn²·e = 0, e = q - q_d.

    Torque      τ = D(q)·v + H(q, q̇) + G(q) + Fv·q̇ + Fc·tanh(q̇_d/v_s),  v = q̈_d - 2ζωn·ė - ωn²·e

    Coulomb friction is compensated by the sign of the reference speed: the measured one would chatter near standstill.
    State and reference are the observer's, one cycle ahead (`observer.ArmState`), and the torque is held while the
    reference stands (`standing`). The model is in the loop, so there is no feed-forward by default; a table would count
    the model twice. The first torque after `start` is the model's torque at the measured state.

    Limits: it is as good as the model. A payload of ±50 % on konkuk1 leaves 2.1 LSB (1 LSB = 1.06°), little better than
    PD with the table: nothing integrates or adapts, and this law is a benchmark. ωn and ζ are the cell's
    `control.natural_frequency_rad_s` and `control.damping_ratio`, the same as for `pd`. With the observer the error at
    the right payload falls up to ωn = 120 rad/s (0.04 LSB), also with one more cycle of delay; without it, it rises
    with ωn: 0.05 at 24, 0.27 at 120.

    Source: Luh, Walker and Paul, IEEE Trans. Automatic Control 25 (1980) 468-474.
    """

    name: ClassVar[str] = "computed-torque"
    following_error_lsb: ClassVar[float] = 5.0
    takes_feedforward: ClassVar[bool] = False

    def __init__(self, arm: Arm, control: Control, period_s: float) -> None:
        own = [control.of_joint(name) for name in arm.joint_names]
        gains = [
            (each.natural_frequency_rad_s**2, 2.0 * each.damping_ratio * each.natural_frequency_rad_s) for each in own
        ]
        self._gains = [(stiffness, damping, damping / stiffness) for stiffness, damping in gains]
        self._model = arm_model(arm)
        self._state = ArmState(control.observer, period_s, arm.joint_count)
        self._standing = StandingHold(control.standing_band_rad, arm.joint_count)
        self._error_rad: Sequence[float] = (0.0,) * arm.joint_count

    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        """Observer at the measured state."""
        self._state.start(position_rad, velocity_rad_s)
        self._standing.start()

    def shift(self, shift_rad: Sequence[float]) -> None:
        """The observer's angles are shifted."""
        self._state.shift(shift_rad)

    def update(self, cycle: Cycle) -> Sequence[float]:
        """Torques in N·m."""
        state, model = self._state, self._model
        state.update(cycle, self._acceleration)
        q, qd, speeds = state.position_rad, state.velocity_rad_s, state.reference_rad_s
        errors: list[float] = []
        aimed: list[float] = []
        deviation_rad: list[float] = []
        rows = zip(q, qd, state.reference_rad, speeds, cycle.reference_rad_s2, self._gains, strict=True)
        for angle, speed, wanted, wanted_speed, change, (stiffness, damping, lead) in rows:
            error, rate = angle - wanted, speed - wanted_speed
            errors.append(error)
            aimed.append(change - damping * rate - stiffness * error)
            deviation_rad.append(error + lead * rate)
        self._error_rad = errors
        modelled = model.at(q, qd, qd, aimed, speeds).torque_nm(model.nominal)
        torque_nm = [torque + ahead for torque, ahead in zip(modelled, cycle.feedforward_nm, strict=True)]
        return self._standing.apply(cycle, deviation_rad, torque_nm)

    def internals(self) -> Mapping[str, Sequence[float]]:
        """Position and speed as the law sees them, and the error (rad)."""
        return {
            "state_rad": list(self._state.position_rad),
            "state_rad_s": list(self._state.velocity_rad_s),
            "error_rad": list(self._error_rad),
        }

    def _acceleration(self, q: Sequence[float], qd: Sequence[float], torque_nm: Sequence[float]) -> Sequence[float]:
        return self._model.acceleration(self._model.nominal, q, qd, torque_nm)
