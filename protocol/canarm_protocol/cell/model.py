"""The schema of a cell: robots, cards, wiring, bus and control gains, as frozen values.

A cell holds *nominal* parameters, known to every program. What differs in the true robot never enters here. What
several values must have in common, `cell_checks.py` says.
Units stand in the key names; angles are degrees in the file because people write the file.
"""

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
NodeId = Annotated[int, Field(ge=1, le=127)]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]*$", max_length=32)]
Vector = tuple[Finite, Finite, Finite]


class Table(BaseModel):
    """One table of the TOML file: strict types, unknown keys refused, frozen."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class CardModel(StrEnum):
    """The cards that the emulator has, by the name used in `[[card]] model`."""

    DAC0808 = "dac0808"
    LATCH = "sc300"
    ADC0809 = "adc0809"


class Quantity(StrEnum):
    """What a card channel is wired to at a joint."""

    CURRENT_COMMAND = "current_command"
    DIRECTION = "direction"
    POTENTIOMETER = "potentiometer"
    TACHOMETER = "tachometer"
    CURRENT_SENSE = "current_sense"


class Bus(Table):
    """The robot's CAN bus."""

    bitrate: Literal[10_000, 20_000, 50_000, 125_000, 250_000, 500_000, 800_000, 1_000_000]
    cycle_us: Annotated[int, Field(ge=500, le=100_000)]
    heartbeat_ms: Annotated[int, Field(ge=1, le=10_000)]
    heartbeat_timeout_ms: Annotated[int, Field(ge=2, le=60_000)]
    controller_node_id: NodeId
    bench_node_id: NodeId
    compute_delay_us: Annotated[int, Field(ge=0)] = 500

    @property
    def cycle_ns(self) -> int:
        """Cycle time, the period of SYNC, in ns."""
        return self.cycle_us * 1000

    @property
    def cycle_s(self) -> float:
        """Cycle time in s."""
        return self.cycle_us * 1e-6


class Physics(Table):
    """How finely the emulator integrates. The longest step bounds the error of the motion."""

    max_step_us: Annotated[int, Field(ge=10, le=2000)]


class Link(Table):
    """Standard Denavit-Hartenberg parameters of one revolute joint and the inertia of its link.

    `centre_of_mass_m` and `inertia_kg_m2` (principal moments about the centre of mass) are in the link's own frame.
    """

    a_m: Finite
    alpha_deg: Finite
    d_m: Finite
    theta_offset_deg: Finite = 0.0
    mass_kg: Positive
    centre_of_mass_m: Vector
    inertia_kg_m2: tuple[NonNegative, NonNegative, NonNegative]


class Motor(Table):
    """DC motor, gear and wire drive of one joint."""

    torque_constant_nm_a: Positive
    gear_ratio: Positive
    gear_efficiency: Annotated[float, Field(gt=0, le=1)]
    rotor_inertia_kg_m2: Positive
    winding_ohm: Positive
    winding_mh: Positive
    viscous_friction_nm_s: NonNegative
    coulomb_friction_nm: NonNegative
    wire_stiffness_nm_rad: Positive

    @property
    def torque_per_ampere(self) -> float:
        """K_I: joint torque per ampere of motor current, N·m/A."""
        return self.torque_constant_nm_a * self.gear_ratio * self.gear_efficiency

    @property
    def reflected_inertia_kg_m2(self) -> float:
        """Rotor inertia seen at the joint, N²·J_rotor, kg·m²."""
        return self.rotor_inertia_kg_m2 * self.gear_ratio**2

    @property
    def back_emf_v_s_rad(self) -> float:
        """Back-EMF per rad/s of joint speed, V·s/rad (K_e = K_t in SI units)."""
        return self.torque_constant_nm_a * self.gear_ratio


class Amplifier(Table):
    """Op-amp and D669 current amplifier with its bridge."""

    max_current_a: Positive
    supply_v: Positive
    opamp_full_scale_v: Positive


class Sensors(Table):
    """Scale factors of the joint's sensors, as voltages at the ADC."""

    potentiometer_range_deg: Positive
    potentiometer_zero_v: NonNegative
    tachometer_full_scale_rad_s: Positive
    tachometer_zero_v: NonNegative
    current_sense_full_scale_a: Positive
    full_scale_v: Positive
    noise_lsb: NonNegative


class Joint(Table):
    """One joint with its link, drive and sensors."""

    name: Name
    home_deg: Finite
    limits_deg: tuple[Finite, Finite]
    link: Link
    motor: Motor
    amplifier: Amplifier
    sensors: Sensors


class Robot(Table):
    """A serial arm of revolute joints, base to tip."""

    name: Name
    number: Annotated[int, Field(ge=1, le=7)]
    gravity_m_s2: Vector
    joint: Annotated[tuple[Joint, ...], Field(min_length=1, max_length=6)]


class Channel(Table):
    """One wire: channel `number` of a card (1-based, as CiA 401 counts) to `signal` = "<joint>.<quantity>"."""

    number: Annotated[int, Field(ge=1, le=8)]
    signal: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]*\.[a-z_]+$")]
    error_value: Annotated[int, Field(ge=0, le=255)] = 0
    """What an output channel takes when the controller is lost: a DAC code, or direction bits. 0: no current, off."""

    @property
    def joint(self) -> str:
        """Name of the joint at the far end of the wire."""
        return self.signal.split(".")[0]

    @property
    def quantity(self) -> str:
        """Name of the quantity at the far end of the wire, a value of `Quantity`."""
        return self.signal.split(".")[1]


class Card(Table):
    """A peripheral card: a slot of one robot's Apple II, and a CANopen node."""

    name: Name
    model: CardModel = Field(strict=False)
    robot: Name
    slot: Annotated[int, Field(ge=1, le=7)]
    node_id: NodeId
    conversion_us: Annotated[int, Field(ge=1, le=10_000)] = 100
    channel: Annotated[tuple[Channel, ...], Field(min_length=1, max_length=8)]


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

    Noise of the sensors is a standard deviation a sample, that of the states a density: rad/s²/√Hz for acceleration
    and tachometer offset, rad/s³/√Hz for the error of the model's acceleration.
    """

    enabled: bool
    position_noise_rad: Positive
    velocity_noise_rad_s: Positive
    acceleration_noise: Positive
    acceleration_bias_noise: NonNegative
    tachometer_offset_noise: NonNegative


class Control(Table):
    """Gains of the control laws. A law without its table cannot be used; without `observer` laws see raw values."""

    natural_frequency_rad_s: Positive
    damping_ratio: Positive
    standing_band_rad: NonNegative = 0.0
    mras: MrasGains
    mras_lyapunov: MrasLyapunovGains | None = None
    slotine_li: SlotineLiGains | None = None
    observer: ObserverGains | None = None


class Supervision(Table):
    """Limits beyond which the controller stops the robot."""

    missing_cycles: Annotated[int, Field(ge=1, le=1000)]
    range_margin_deg: NonNegative
    max_position_step_deg: Positive
    position_jump_lsb: Positive = 4.5
    position_drift_lsb: Positive = 0.65
    speed_jump_lsb: Positive = 5.0
    speed_drift_lsb: Positive = 2.2
    current_mismatch_a: Positive = 0.075
    acceleration_mismatch_rad_s2: Positive = 4.0


CHANNELS_OF: dict[CardModel, tuple[Quantity, ...]] = {
    CardModel.DAC0808: (Quantity.CURRENT_COMMAND,),
    CardModel.LATCH: (Quantity.DIRECTION,),
    CardModel.ADC0809: (Quantity.POTENTIOMETER, Quantity.TACHOMETER, Quantity.CURRENT_SENSE),
}
"""Which quantities can be wired to which card."""

CHANNEL_COUNT: dict[CardModel, int] = {CardModel.DAC0808: 4, CardModel.LATCH: 4, CardModel.ADC0809: 8}
"""Channels of a card: four DAC0808s behind two 4-bit latches each; eight latch bits, two a joint; an 8-channel ADC."""


class Cell(Table):
    """A whole cell; see the shipped `cells/konkuk1.toml` for every key with its unit."""

    name: Name
    title: str
    bus: Bus
    physics: Physics
    robot: Annotated[tuple[Robot, ...], Field(min_length=1, max_length=7)]
    card: Annotated[tuple[Card, ...], Field(min_length=1, max_length=49)]
    control: Control
    supervision: Supervision

    @property
    def joints(self) -> tuple[Joint, ...]:
        """All joints, robot by robot, base to tip."""
        return tuple(joint for robot in self.robot for joint in robot.joint)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of `joints`, in the same order."""
        return tuple(joint.name for joint in self.joints)
