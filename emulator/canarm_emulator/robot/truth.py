"""The true parameters of the robot and its converters: those of the cell, changed by `--truth`.

The controller never sees any of this. Geometry and limits are always those of the cell.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

from canarm_protocol.cell.model import Carried, Cell, Joint

from ..errors import TruthError
from .joint_truth import JointTruth
from .sensors.registry import SENSORS
from .truth_keys import Parameter, TruthKey, parse_value

__all__ = ["AdcTruth", "DacTruth", "JointTruth", "ObjectTruth", "Truth", "TruthKey", "truth_keys"]


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
class ObjectTruth:
    """The object that two robots carry, how well they hold it, and how far the slave's base stands from where the cell
    has it, along the world's axes.
    """

    mass_kg: float
    slip_force_n: float
    base_x_m: float = 0.0
    base_y_m: float = 0.0
    base_z_m: float = 0.0


_JOINT_PARAMETERS = (
    Parameter("mass", "mass_kg", "kg", "mass of the link; its inertia scales with it", 1e-3, 1e3),
    Parameter("viscous", "viscous_friction_nm_s", "N·m·s/rad", "viscous friction at the joint", 0.0, 100.0),
    Parameter("coulomb", "coulomb_friction_nm", "N·m", "Coulomb friction at the joint", 0.0, 100.0),
    Parameter("torque_constant", "torque_constant_nm_a", "N·m/A", "torque constant of the motor", 1e-4, 10.0),
    Parameter("rotor_inertia", "rotor_inertia_kg_m2", "kg·m²", "inertia of the motor's rotor", 1e-8, 1.0),
    Parameter("winding_ohm", "winding_ohm", "ohm", "resistance of the motor's winding", 1e-2, 1e3),
    Parameter("wire", "has_elastic_wire", "", "drive wire: 0 rigid, 1 elastic", 0.0, 1.0, is_switch=True),
    Parameter("wire_stiffness", "wire_stiffness_nm_rad", "N·m/rad", "stiffness of the elastic wire", 1.0, 5e3),
    Parameter("supply_v", "supply_v", "V", "supply of the joint's amplifier", 0.0, 1e3),
    Parameter("initial_deg", "initial_deg", "deg", "angle at which the arm is parked", -360.0, 360.0),
)
_NOISE = Parameter("noise_lsb", "noise_lsb", "LSB", "noise of all the joint's sensors, standard deviation", 0.0, 255.0)
_ADC_PARAMETERS = (
    Parameter("offset_lsb", "offset_lsb", "LSB", "added to every ADC reading", -255.0, 255.0),
    Parameter("gain_error", "gain_error", "", "every ADC reads 1 + this times the voltage", -0.5, 0.5),
    Parameter("nonlinearity_lsb", "nonlinearity_lsb", "LSB", "largest bow of the ADC's curve", -16.0, 16.0),
)
_DAC_PARAMETERS = (
    Parameter("nonlinearity", "nonlinearity", "full scale", "largest bow of the DAC's curve", -0.1, 0.1),
)
_OBJECT_PARAMETERS = (
    Parameter("mass", "mass_kg", "kg", "mass of the object; its inertia scales with it", 1e-3, 1e3),
    Parameter("slip_force", "slip_force_n", "N", "force at which a hand loses the object", 0.1, 1e6),
    Parameter("base_x", "base_x_m", "m", "how far the slave's base is off along x", -0.02, 0.02),
    Parameter("base_y", "base_y_m", "m", "how far the slave's base is off along y", -0.02, 0.02),
    Parameter("base_z", "base_z_m", "m", "how far the slave's base is off along z", -0.02, 0.02),
)


@dataclass(frozen=True, slots=True)
class Truth:
    """True parameters of a cell: `joints` in the order of `Cell.joints`, the errors of the converters, the object."""

    joints: tuple[JointTruth, ...]
    adc: AdcTruth = field(default_factory=AdcTruth)
    dac: DacTruth = field(default_factory=DacTruth)
    object: ObjectTruth | None = None

    @classmethod
    def from_settings(cls, cell: Cell, settings: Mapping[str, str] | None = None, option: str = "--truth") -> Self:
        """Nominal values of `cell`, with `settings` ("joint3.mass" → "0.9"), given in `option`, laid over them.

        Raises `TruthError` with one line per problem: key, value, and what would be right.
        """
        keys = {key.name: key for key in truth_keys(cell)}
        problems: list[str] = []
        values: dict[str, float] = {}
        for name, text in (settings or {}).items():
            try:
                values[name] = parse_value(keys, name, text, option)
            except TruthError as error:
                problems.append(str(error))
        if problems:
            raise TruthError("\n".join(problems))

        def true_joint(name: str, joint: Joint) -> JointTruth:
            rows, nominal = _sensor_parameters(joint), _nominal(joint)
            common = values.get(f"{name}.{_NOISE.leaf}")
            noise = {} if common is None else dict.fromkeys(_noise_fields(joint), common)
            sensors = {**nominal.sensors, **noise, **given(name, rows)}
            return replace(nominal, sensors=sensors, **given(name, _JOINT_PARAMETERS))

        def given(owner: str, parameters: tuple[Parameter, ...]) -> dict[str, Any]:
            rows = ((row, values.get(f"{owner}.{row.leaf}")) for row in parameters)
            return {row.field: bool(v) if row.is_switch else v for row, v in rows if v is not None}

        return cls(
            tuple(true_joint(name, joint) for name, joint in zip(cell.joint_names, cell.joints, strict=True)),
            AdcTruth(**given("adc", _ADC_PARAMETERS)),
            DacTruth(**given("dac", _DAC_PARAMETERS)),
            None if cell.object is None else replace(_of_object(cell.object), **given("object", _OBJECT_PARAMETERS)),
        )


def truth_keys(cell: Cell) -> list[TruthKey]:
    """Every key that `--truth` takes for `cell`, joint by joint, then the converters."""
    keys: list[TruthKey] = []
    for name, joint in zip(cell.joint_names, cell.joints, strict=True):
        nominal = _nominal(joint)
        for parameter in _JOINT_PARAMETERS:
            limits = joint.limits_deg if parameter.field == "initial_deg" else None
            keys.append(parameter.key(name, float(getattr(nominal, parameter.field)), limits))
        rows = _sensor_parameters(joint)
        noisy = _noise_fields(joint)
        if noisy:
            keys.append(_NOISE.key(name, nominal.sensors[noisy[0]]))
        keys += [row.key(name, nominal.sensors[row.field]) for row in rows]
    keys += [parameter.key("adc", getattr(AdcTruth(), parameter.field)) for parameter in _ADC_PARAMETERS]
    keys += [parameter.key("dac", getattr(DacTruth(), parameter.field)) for parameter in _DAC_PARAMETERS]
    if cell.object is not None:
        nominal_object = _of_object(cell.object)
        keys += [row.key("object", getattr(nominal_object, row.field)) for row in _OBJECT_PARAMETERS]
    return keys


def _sensor_parameters(joint: Joint) -> tuple[Parameter, ...]:
    return tuple(row for sensor in joint.sensors.fitted() for row in SENSORS[sensor.kind].parameters)


def _noise_fields(joint: Joint) -> list[str]:
    rows = (SENSORS[sensor.kind].noise for sensor in joint.sensors.fitted())
    return [row.field for row in rows if row is not None]


def _of_object(carried: Carried) -> ObjectTruth:
    return ObjectTruth(mass_kg=carried.mass_kg, slip_force_n=carried.slip_force_n)


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
        sensors={
            field: value
            for sensor in joint.sensors.fitted()
            for field, value in SENSORS[sensor.kind].nominal(sensor).items()
        },
        supply_v=joint.drive.supply_v,
        initial_deg=joint.home_deg,
    )
