"""What is true of this robot and its converters, where it differs from the cell: the values of `--truth`.

The controller never sees any of this. Nominal values come from the cell; geometry and limits always do.
"""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

from canarm_protocol.cell.model import Cell, Joint, Quantity
from canarm_protocol.cell.sensors import AnalogueSensor

from ..errors import TruthError

SWITCH = {"false": 0.0, "true": 1.0}
"""Words for a switch, beside 0 and 1."""


@dataclass(frozen=True, slots=True)
class JointTruth:
    """True parameters of one joint. Those with a default are no keys of `--truth`: faults alone set them."""

    mass_kg: float
    viscous_friction_nm_s: float
    coulomb_friction_nm: float
    torque_constant_nm_a: float
    rotor_inertia_kg_m2: float
    winding_ohm: float
    has_elastic_wire: bool
    wire_stiffness_nm_rad: float
    potentiometer_offset_deg: float
    tachometer_offset_rad_s: float
    noise_lsb: float | None
    """Of all the joint's sensors; None where each has its own."""
    supply_v: float
    initial_deg: float
    payload_kg: float = 0.0
    """Point mass at the far end of the link, where the next link's axis is."""
    is_jammed: bool = False
    """The joint is held on the link's side of the drive wire."""
    wire_dead_band_rad: float = 0.0
    """Twist of an elastic wire, either way, over which it has no tension."""
    wire_is_broken: bool = False
    """An elastic wire connects nothing: the motor turns alone and the link hangs."""
    shorted_turns: float = 0.0
    """Share of the winding's turns that are shorted."""

    def noise_of(self, sensor: AnalogueSensor) -> float:
        """Noise of one of the joint's sensors, steps of its ADC."""
        return sensor.noise_lsb if self.noise_lsb is None else self.noise_lsb


@dataclass(frozen=True, slots=True)
class AdcTruth:
    """Errors of every ADC, in steps (LSB) of its code; the card models apply them."""

    offset_lsb: float = 0.0
    gain_error: float = 0.0
    nonlinearity_lsb: float = 0.0


@dataclass(frozen=True, slots=True)
class DacTruth:
    """Error of every DAC, as a fraction of full scale; the card models apply it."""

    nonlinearity: float = 0.0


@dataclass(frozen=True, slots=True)
class TruthKey:
    """One key of `--truth`. `minimum` and `maximum` are inclusive; a switch takes 0 or 1."""

    name: str
    unit: str
    nominal: float
    description: str
    minimum: float
    maximum: float
    is_switch: bool = False


@dataclass(frozen=True, slots=True)
class _Parameter:
    """A row of the tables below: a key's last part, and the field that it sets."""

    leaf: str
    field: str
    unit: str
    description: str
    minimum: float
    maximum: float
    is_switch: bool = False

    def key(self, owner: str, nominal: float, limits: tuple[float, float] | None = None) -> TruthKey:
        low, high = limits or (self.minimum, self.maximum)
        return TruthKey(f"{owner}.{self.leaf}", self.unit, nominal, self.description, low, high, self.is_switch)


# Bounds keep the integrator stable and catch a slipped unit; they are not limits of any part.
_JOINT_PARAMETERS = (
    _Parameter("mass", "mass_kg", "kg", "mass of the link; its inertia scales with it", 1e-3, 1e3),
    _Parameter("viscous", "viscous_friction_nm_s", "N·m·s/rad", "viscous friction at the joint", 0.0, 100.0),
    _Parameter("coulomb", "coulomb_friction_nm", "N·m", "Coulomb friction at the joint", 0.0, 100.0),
    _Parameter("torque_constant", "torque_constant_nm_a", "N·m/A", "torque constant of the motor", 1e-4, 10.0),
    _Parameter("rotor_inertia", "rotor_inertia_kg_m2", "kg·m²", "inertia of the motor's rotor", 1e-8, 1.0),
    _Parameter("winding_ohm", "winding_ohm", "ohm", "resistance of the motor's winding", 1e-2, 1e3),
    _Parameter("wire", "has_elastic_wire", "", "drive wire: 0 rigid, 1 elastic", 0.0, 1.0, is_switch=True),
    _Parameter("wire_stiffness", "wire_stiffness_nm_rad", "N·m/rad", "stiffness of the elastic wire", 1.0, 5e3),
    _Parameter("potentiometer_offset_deg", "potentiometer_offset_deg", "deg", "added to the angle read", -360.0, 360.0),
    _Parameter("tachometer_offset", "tachometer_offset_rad_s", "rad/s", "added to the speed read", -100.0, 100.0),
    _Parameter("noise_lsb", "noise_lsb", "LSB", "noise of the joint's sensors, standard deviation", 0.0, 255.0),
    _Parameter("supply_v", "supply_v", "V", "supply of the joint's amplifier", 0.0, 1e3),
    _Parameter("initial_deg", "initial_deg", "deg", "angle at which the arm is parked", -360.0, 360.0),
)
_ADC_PARAMETERS = (
    _Parameter("offset_lsb", "offset_lsb", "LSB", "added to every ADC reading", -255.0, 255.0),
    _Parameter("gain_error", "gain_error", "", "every ADC reads 1 + this times the voltage", -0.5, 0.5),
    _Parameter("nonlinearity_lsb", "nonlinearity_lsb", "LSB", "largest bow of the ADC's curve", -16.0, 16.0),
)
_DAC_PARAMETERS = (
    _Parameter("nonlinearity", "nonlinearity", "full scale", "largest bow of the DAC's curve", -0.1, 0.1),
)


@dataclass(frozen=True, slots=True)
class Truth:
    """True parameters of a cell: `joints` in the order of `Cell.joints`, and the errors of the converters."""

    joints: tuple[JointTruth, ...]
    adc: AdcTruth = field(default_factory=AdcTruth)
    dac: DacTruth = field(default_factory=DacTruth)

    @classmethod
    def from_settings(cls, cell: Cell, settings: Mapping[str, str] | None = None) -> Self:
        """Nominal values of `cell`, with `settings` ("joint3.mass" → "0.9") laid over them.

        Raises `TruthError`, one line a problem: key, value, and what would be right.
        """
        keys = {key.name: key for key in truth_keys(cell)}
        problems: list[str] = []
        values: dict[str, float] = {}
        for name, text in (settings or {}).items():
            try:
                values[name] = _parse(keys, name, text)
            except TruthError as error:
                problems.append(str(error))
        if problems:
            raise TruthError("\n".join(problems))

        def given(owner: str, parameters: tuple[_Parameter, ...]) -> dict[str, Any]:
            rows = ((row, values.get(f"{owner}.{row.leaf}")) for row in parameters)
            return {row.field: bool(v) if row.is_switch else v for row, v in rows if v is not None}

        return cls(
            tuple(
                replace(_nominal(joint), **given(name, _JOINT_PARAMETERS))
                for name, joint in zip(cell.joint_names, cell.joints, strict=True)
            ),
            AdcTruth(**given("adc", _ADC_PARAMETERS)),
            DacTruth(**given("dac", _DAC_PARAMETERS)),
        )


def truth_keys(cell: Cell) -> list[TruthKey]:
    """Every key that `--truth` takes for `cell`, joint by joint, then the converters."""
    keys: list[TruthKey] = []
    for name, joint in zip(cell.joint_names, cell.joints, strict=True):
        position = joint.sensor(Quantity.POSITION)
        noise_lsb = position.noise_lsb if isinstance(position, AnalogueSensor) else 0.0
        nominal = replace(_nominal(joint), noise_lsb=noise_lsb)
        for parameter in _JOINT_PARAMETERS:
            limits = joint.limits_deg if parameter.field == "initial_deg" else None
            keys.append(parameter.key(name, float(getattr(nominal, parameter.field)), limits))
    keys += [parameter.key("adc", getattr(AdcTruth(), parameter.field)) for parameter in _ADC_PARAMETERS]
    keys += [parameter.key("dac", getattr(DacTruth(), parameter.field)) for parameter in _DAC_PARAMETERS]
    return keys


def _nominal(joint: Joint) -> JointTruth:
    return JointTruth(
        mass_kg=joint.mass_kg,
        viscous_friction_nm_s=joint.motor.viscous_friction_nm_s,
        coulomb_friction_nm=joint.motor.coulomb_friction_nm,
        torque_constant_nm_a=joint.motor.torque_constant_nm_a,
        rotor_inertia_kg_m2=joint.motor.rotor_inertia_kg_m2,
        winding_ohm=joint.motor.winding_ohm,
        has_elastic_wire=False,
        wire_stiffness_nm_rad=joint.motor.wire_stiffness_nm_rad,
        potentiometer_offset_deg=0.0,
        tachometer_offset_rad_s=0.0,
        noise_lsb=None,
        supply_v=joint.drive.supply_v,
        initial_deg=joint.home_deg,
    )


def _parse(keys: Mapping[str, TruthKey], name: str, text: str) -> float:
    key = keys.get(name)
    if key is None:
        close = difflib.get_close_matches(name, keys, n=1)
        hint = f"did you mean {close[0]!r}?" if close else "see `canarm check --keys`"
        raise TruthError(f"--truth {name}={text}: no such key; {hint}")
    try:
        value = SWITCH[text.lower()] if key.is_switch and text.lower() in SWITCH else float(text)
    except ValueError:
        value = math.nan
    if key.is_switch and value not in (0.0, 1.0):
        raise TruthError(f"--truth {name}={text}: must be 0 or 1, false or true ({key.description})")
    if not key.minimum <= value <= key.maximum:
        unit = f" {key.unit}" if key.unit else ""
        raise TruthError(
            f"--truth {name}={text}: must be a number from {key.minimum:g} to {key.maximum:g}{unit} "
            f"({key.description}; nominal {key.nominal:g})"
        )
    return value
