"""What is identified, in terms of a cell: masses, centres, friction, torque constants; and the currents they predict.

Owns the step from these to the base parameters of the regressor. Estimation is not known here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from canarm_controller.dynamics.inertial_regressor import InertialRegressor
from canarm_protocol.cell.model import Robot

from .motion import Floats

CENTRES = (0.9, 1.0, 1.1)
"""Multiples of a centre at which a link's share of the base parameters, a quadratic, is worked out. They are near 1:
where a moment vanishes, as for a centre on the joint's axis, it is no parameter any more.
"""
SMOOTHING_RAD_S = 0.002
"""Friction turns round within this speed, a tenth of what the controller assumes: afterwards speeds are smooth."""


class Kind(Enum):
    """A kind of parameter; its value is the plural, as `--free` takes it."""

    MASS = "masses"
    CENTRE = "centres"
    COULOMB = "coulomb"
    VISCOUS = "viscous"
    TORQUE_CONSTANT = "torque-constants"


UNITS = {Kind.MASS: "kg", Kind.CENTRE: "m", Kind.COULOMB: "N m", Kind.VISCOUS: "N m s", Kind.TORQUE_CONSTANT: "N m/A"}
NAMES = {
    Kind.MASS: "mass",
    Kind.CENTRE: "centre",
    Kind.COULOMB: "coulomb",
    Kind.VISCOUS: "viscous",
    Kind.TORQUE_CONSTANT: "torque_constant",
}
USUAL = (Kind.MASS, Kind.COULOMB, Kind.VISCOUS, Kind.TORQUE_CONSTANT)
"""Without the centres: a link that is nearer and heavier weighs the same, and only its inertia tells."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a joint; `nominal` is the cell's, `scale` is how large a usual change of it is."""

    joint: str
    place: int
    kind: Kind
    nominal: float
    scale: float

    @property
    def name(self) -> str:
        """As in `--truth`: joint3.mass."""
        return f"{self.joint}.{NAMES[self.kind]}"


class ArmPrediction:
    """The motor currents of one robot, from its motion and values of its `parameters`.

    `names` are the joints' names in the cell. A link's inertia about its centre goes with its mass; its centre moves
    along the line from the joint's frame to the cell's centre.
    """

    def __init__(self, robot: Robot, names: Sequence[str], free: Sequence[Kind]) -> None:
        self._robot = robot
        self._regressor = InertialRegressor(robot, SMOOTHING_RAD_S)
        self._per_ampere = np.array([joint.motor.torque_per_ampere for joint in robot.joint])
        count = len(robot.joint)
        motors = [joint.motor for joint in robot.joint]
        self._usual = {kind: np.ones(count) for kind in (Kind.MASS, Kind.CENTRE, Kind.TORQUE_CONSTANT)}
        self._usual[Kind.COULOMB] = np.array([motor.coulomb_friction_nm for motor in motors])
        self._usual[Kind.VISCOUS] = np.array([motor.viscous_friction_nm_s for motor in motors])
        places = [(each.joint, each.kind) for each in self._regressor.parameters]
        self._friction = {
            kind: np.array([[float(place == (joint, NAMES[kind])) for joint in range(count)] for place in places])
            for kind in (Kind.COULOMB, Kind.VISCOUS)
        }
        self._shares = self._link_shares()
        whole = self._inertial(np.ones(count), np.ones(count))
        self._rest = whole - sum((share.sum(axis=1) for share in self._shares), np.zeros(len(whole)))
        self.parameters = tuple(
            Parameter(names[place], place, kind, nominal, scale)
            for kind in Kind
            if kind in free
            for place, (nominal, scale) in enumerate(_nominals(robot, kind))
            if scale > 0.0
        )

    def rows(self, angle_rad: Floats, speed_rad_s: Floats, acceleration_rad_s2: Floats) -> Floats:
        """The regressor for arrays (samples, joints): (samples, joints, base parameters)."""
        return self._regressor.rows(angle_rad, speed_rad_s, acceleration_rad_s2)

    def currents(self, rows: Floats, values: Floats) -> Floats:
        """Currents (samples, joints) in A, for `rows` and a value of each parameter."""
        of = self._by_kind(values)
        return np.asarray(rows @ self._base(of) / (self._per_ampere * of[Kind.TORQUE_CONSTANT]), dtype=np.float64)

    def jacobian(self, rows: Floats, values: Floats) -> Floats:
        """Derivatives of `currents`, (samples, joints, parameters)."""
        of = self._by_kind(values)
        per_ampere = self._per_ampere * of[Kind.TORQUE_CONSTANT]
        found = np.zeros((*rows.shape[:2], len(self.parameters)))
        for place, (parameter, value) in enumerate(zip(self.parameters, values.tolist(), strict=True)):
            joint = parameter.place
            if parameter.kind is Kind.TORQUE_CONSTANT:
                found[:, joint, place] = -(rows[:, joint] @ self._base(of)) / (per_ampere[joint] * value)
            else:
                found[:, :, place] = rows @ self._slope(parameter, of) / per_ampere
        return found

    def _by_kind(self, values: Floats) -> dict[Kind, Floats]:
        """A number for each joint and kind: friction as it is, everything else as a multiple of the cell's."""
        of = {kind: each.copy() for kind, each in self._usual.items()}
        for parameter, value in zip(self.parameters, values.tolist(), strict=True):
            is_friction = parameter.kind in (Kind.COULOMB, Kind.VISCOUS)
            of[parameter.kind][parameter.place] = value if is_friction else value / parameter.nominal
        return of

    def _base(self, of: dict[Kind, Floats]) -> Floats:
        """The base parameters: what no link has a share in, the links' shares, friction."""
        base = self._rest.copy()
        for share, mass, centre in zip(self._shares, of[Kind.MASS], of[Kind.CENTRE], strict=True):
            base += mass * (share @ centre ** np.arange(3))
        for kind, columns in self._friction.items():
            base += columns @ of[kind]
        return base

    def _slope(self, parameter: Parameter, of: dict[Kind, Floats]) -> Floats:
        """Derivative of the base parameters by one parameter."""
        joint = parameter.place
        if parameter.kind in self._friction:
            return np.asarray(self._friction[parameter.kind][:, joint])
        mass, centre = of[Kind.MASS][joint], of[Kind.CENTRE][joint]
        powers = centre ** np.arange(3)
        if parameter.kind is Kind.CENTRE:
            powers = mass * np.array([0.0, 1.0, 2.0 * centre])
        return np.asarray(self._shares[joint] @ powers / parameter.nominal)

    def _link_shares(self) -> list[Floats]:
        """Each link's share of the base parameters, for its own mass: (base parameters, powers of the centre)."""
        count = len(self._robot.joint)
        powers = np.vander(np.array(CENTRES), 3, increasing=True)
        found = []
        for joint in range(count):
            shares = []
            for centre in CENTRES:
                masses, centres = np.ones(count), np.ones(count)
                centres[joint] = centre
                single = self._inertial(masses, centres)
                masses[joint] = 2.0
                shares.append(self._inertial(masses, centres) - single)
            found.append(np.linalg.solve(powers, np.array(shares)).T)
        return found

    def _inertial(self, masses: Floats, centres: Floats) -> Floats:
        none = [0.0] * len(self._robot.joint)
        return self._regressor.values(_changed(self._robot, masses.tolist(), centres.tolist()), none, none)


def _nominals(robot: Robot, kind: Kind) -> list[tuple[float, float]]:
    """The cell's value of each joint, and the size of a usual change; 0 where there is nothing to be found."""
    found = []
    for joint in robot.joint:
        motor, torque_nm = joint.motor, joint.drive.max_current_a * joint.motor.torque_per_ampere
        match kind:
            case Kind.MASS:
                value = scale = joint.mass_kg
            case Kind.CENTRE:
                value = scale = float(np.linalg.norm(joint.solid.centre_of_mass_m))
            case Kind.TORQUE_CONSTANT:
                value = scale = motor.torque_constant_nm_a
            case Kind.COULOMB:
                value, scale = motor.coulomb_friction_nm, max(motor.coulomb_friction_nm, 0.01 * torque_nm)
            case Kind.VISCOUS:
                value = motor.viscous_friction_nm_s
                scale = max(value, 0.01 * torque_nm / joint.allowed_rad_s)
        found.append((value, scale))
    return found


def _changed(robot: Robot, masses: Sequence[float], centres: Sequence[float]) -> Robot:
    joints = []
    for joint, mass, centre in zip(robot.joint, masses, centres, strict=True):
        solid = joint.solid
        x, y, z = (centre * each for each in solid.centre_of_mass_m)
        xx, yy, zz, xy, xz, yz = (mass * each for each in solid.tensor_kg_m2)
        other = solid.with_inertial(mass * solid.mass_kg, (x, y, z), (xx, yy, zz, xy, xz, yz))
        joints.append(joint.model_copy(update={"body" if joint.body else "link": other}))
    return robot.model_copy(update={"joint": tuple(joints)})
