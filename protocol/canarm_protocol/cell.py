"""The schema of a cell: robots, cards, wiring, bus and control gains, as frozen values.

A cell holds *nominal* parameters, known to every program. What differs in the true robot never enters here.
Units stand in the key names; angles are degrees in the file because people write the file.
"""

from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

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

    @model_validator(mode="after")
    def _timeout_is_longer_than_heartbeat(self) -> Self:
        if self.heartbeat_timeout_ms < 2 * self.heartbeat_ms:
            raise ValueError(
                f"heartbeat_timeout_ms = {self.heartbeat_timeout_ms} must be at least twice "
                f"heartbeat_ms = {self.heartbeat_ms}, or one late heartbeat stops the robot"
            )
        return self


class Physics(Table):
    """How finely the emulator integrates. The longest step bounds the error of the motion."""

    max_step_us: Annotated[int, Field(ge=10, le=2000)]


class Link(Table):
    """Standard Denavit-Hartenberg parameters of one revolute joint and the inertia of its link.

    `centre_of_mass_m` and `inertia_kg_m2` (principal moments about the centre of mass) are given in the link's own frame.
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

    @model_validator(mode="after")
    def _home_lies_within_limits(self) -> Self:
        low, high = self.limits_deg
        if not low < high:
            raise ValueError(f"limits_deg = [{low}, {high}] must be [lower, upper] with lower < upper")
        if not low <= self.home_deg <= high:
            raise ValueError(f"home_deg = {self.home_deg} must lie within limits_deg = [{low}, {high}]")
        return self


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


class Control(Table):
    """Gains of the control laws."""

    natural_frequency_rad_s: Positive
    damping_ratio: Positive
    mras: MrasGains


class Supervision(Table):
    """Limits beyond which the controller stops the robot."""

    missing_cycles: Annotated[int, Field(ge=1, le=1000)]
    range_margin_deg: NonNegative
    max_position_step_deg: Positive


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

    @model_validator(mode="after")
    def _parts_fit_together(self) -> Self:
        problems = [
            *_duplicates("robot", "name", [robot.name for robot in self.robot]),
            *_duplicates("robot", "number", [robot.number for robot in self.robot]),
            *_duplicates("robot.joint", "name", self.joint_names),
            *_duplicates("card", "name", [card.name for card in self.card]),
            *_duplicates("card", "node_id", [card.node_id for card in self.card]),
            *_duplicates("card", "slot", [(card.robot, card.slot) for card in self.card]),
            *self._wiring_problems(),
        ]
        if problems:
            raise ValueError("\n".join(problems))
        return self

    def _wiring_problems(self) -> Iterator[str]:
        robots = {robot.name: {joint.name for joint in robot.joint} for robot in self.robot}
        wired: dict[str, str] = {}
        for index, card in enumerate(self.card):
            where = f"card[{index}] {card.name!r}"
            if card.robot not in robots:
                yield f"{where}.robot = {card.robot!r}: no such robot; this cell has {_listed(robots)}"
                continue
            if card.node_id == self.bus.controller_node_id:
                yield f"{where}.node_id = {card.node_id}: is bus.controller_node_id; give the card another one"
            yield from _duplicates(f"{where}.channel", "number", [channel.number for channel in card.channel])
            allowed = CHANNELS_OF[card.model]
            for channel in card.channel:
                spot = f"{where} channel {channel.number}"
                if channel.number > CHANNEL_COUNT[card.model]:
                    yield f"{spot}: a {card.model} has channels 1 to {CHANNEL_COUNT[card.model]}"
                if channel.joint not in robots[card.robot]:
                    yield (
                        f"{spot}.signal = {channel.signal!r}: robot {card.robot!r} has no joint {channel.joint!r}; "
                        f"it has {_listed(robots[card.robot])}"
                    )
                if channel.quantity not in allowed:
                    yield f"{spot}.signal = {channel.signal!r}: a {card.model} takes <joint>.{_listed(allowed, ' or ')}"
                if channel.signal in wired:
                    yield f"{spot}.signal = {channel.signal!r}: already wired to {wired[channel.signal]}; wire it once"
                wired.setdefault(channel.signal, spot)
        for joint in self.joint_names:
            for quantity in Quantity:
                if f"{joint}.{quantity}" not in wired:
                    models = [model for model, quantities in CHANNELS_OF.items() if quantity in quantities]
                    yield f"{joint}.{quantity}: not wired; wire it to a channel of a {_listed(models, ' or ')}"


def _duplicates(where: str, key: str, values: Sequence[object]) -> Iterator[str]:
    for index, value in enumerate(values):
        if (first := values.index(value)) < index:
            yield f"{where}[{index}].{key} = {value!r}: {where}[{first}] has it already; each must be unique"


def _listed(names: Iterable[object], joiner: str = ", ") -> str:
    return joiner.join(map(str, names))
