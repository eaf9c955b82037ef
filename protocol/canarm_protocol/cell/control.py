"""The schema of `[control]`: gains of the laws, of the whole cell and of single joints, as frozen values.

What the gains do is said by the laws.
"""

from typing import Annotated

from pydantic import Field

from .table import NonNegative, Positive, Table


class MrasGains(Table):
    """Dubowsky-DesForges adaptation with bias; symbols as in `canarm_controller.laws.mras`."""

    gamma_alpha: NonNegative
    gamma_beta: NonNegative
    gamma_bias: NonNegative
    error_gain: NonNegative
    error_rate_gain: NonNegative
    leakage: NonNegative
    bias_limit_a: NonNegative


class MrasLyapunovGains(Table):
    """Adaptation by Lyapunov's method; symbols as in `canarm_controller.laws.mras_lyapunov`."""

    gamma_position: NonNegative
    gamma_velocity: NonNegative
    gamma_bias: NonNegative
    leakage: NonNegative
    bias_limit_a: NonNegative


class SlotineLiGains(Table):
    """Adaptation of the whole arm model; symbols as in `canarm_controller.laws.slotine_li`."""

    error_rate_rad_s: Positive
    sliding_rate_rad_s: NonNegative
    adaptation: NonNegative
    leakage: NonNegative


class ObserverGains(Table):
    """How far sensors and arm model can be trusted; see `canarm_controller.estimation.observer`.

    Sensor noise is a standard deviation per sample. Process noise is a density: rad/s²/√Hz for acceleration and
    tachometer offset, rad/s³/√Hz for the error of the model's acceleration.
    """

    enabled: bool
    position_noise_rad: Positive
    velocity_noise_rad_s: Positive
    acceleration_noise: Positive
    acceleration_bias_noise: NonNegative
    tachometer_offset_noise: NonNegative


class JointMrasGains(Table):
    """What differs at one joint from `MrasGains`."""

    gamma_alpha: NonNegative | None = None
    gamma_beta: NonNegative | None = None
    gamma_bias: NonNegative | None = None
    error_gain: NonNegative | None = None
    error_rate_gain: NonNegative | None = None
    leakage: NonNegative | None = None
    bias_limit_a: NonNegative | None = None


class JointMrasLyapunovGains(Table):
    """What differs at one joint from `MrasLyapunovGains`."""

    gamma_position: NonNegative | None = None
    gamma_velocity: NonNegative | None = None
    gamma_bias: NonNegative | None = None
    leakage: NonNegative | None = None
    bias_limit_a: NonNegative | None = None


class JointSlotineLiGains(Table):
    """What differs at one joint from `SlotineLiGains`; what adapts is the arm as a whole."""

    error_rate_rad_s: Positive | None = None
    sliding_rate_rad_s: NonNegative | None = None


class JointControl(Table):
    """How one joint's loop differs, `[[control.joint]]`; for what is left out, the values of `[control]` hold.

    `name` is the joint's in the whole cell.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]*$", max_length=65)]
    natural_frequency_rad_s: Positive | None = None
    damping_ratio: Positive | None = None
    mras: JointMrasGains | None = None
    mras_lyapunov: JointMrasLyapunovGains | None = None
    slotine_li: JointSlotineLiGains | None = None

    def laid_over(self, control: "Control") -> dict[str, object]:
        """The fields of `control` that differ, with what is left out completed from there."""
        found: dict[str, object] = {}
        for key, own in self:
            whole = getattr(control, key, None)
            if isinstance(own, Table) and isinstance(whole, Table):
                found[key] = whole.model_copy(update=own.model_dump(exclude_none=True))
            elif own is not None and whole is not None:
                found[key] = own
        return found

    def without_whole(self, control: "Control") -> list[str]:
        """The names of its tables of which `control` has none."""
        return [key for key, own in self if isinstance(own, Table) and getattr(control, key) is None]


class Homing(Table):
    """Before a run begins, every joint with an encoder moves until the index has shown where it truly stands.

    At power-on a joint is known to stand within `parked_within_deg` of its `home_deg`; no joint moves faster than
    `speed_deg_s`.
    """

    parked_within_deg: Positive
    speed_deg_s: Positive


class Control(Table):
    """Gains of the control laws. A law without its table cannot be used; without `observer`, laws see raw values."""

    natural_frequency_rad_s: Positive
    damping_ratio: Positive
    standing_band_rad: NonNegative = 0.0
    mras: MrasGains
    mras_lyapunov: MrasLyapunovGains | None = None
    slotine_li: SlotineLiGains | None = None
    observer: ObserverGains | None = None
    homing: Homing | None = None
    joint: tuple[JointControl, ...] = ()

    def of_joint(self, name: str) -> "Control":
        """The values that hold at a joint, by its name in the whole cell."""
        for each in self.joint:
            if each.name == name:
                return self.model_copy(update=each.laid_over(self))
        return self
