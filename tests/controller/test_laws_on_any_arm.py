"""Every law on arms of 1 to 7 joints, by the loop itself: codes in, DAC codes out; gains are those of `tuning`.

The plant is Pinocchio's, with Coulomb friction that really holds, 8-bit sensors with noise, one cycle of delay, and
commands that are held by an 8-bit DAC.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

from canarm_controller.dynamics import SerialArm, nominal_arm
from canarm_controller.laws import LAWS, Cycle, load_law
from canarm_controller.laws.tuning import suggested_control
from canarm_controller.reference.trajectory import make_trajectory
from canarm_controller.run.loop import ControlLoop
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.arm import Robot
from canarm_protocol.cell.cell_file import load_cell, parse_cell, shipped_cells
from canarm_protocol.cell.model import Cell, Control
from canarm_protocol.cell.sensing import WiredSensor, joint_sensors
from canarm_protocol.cell.sensors import Quantity
from canarm_protocol.cell.wiring import card_nodes, input_slots

KONKUK = load_cell("konkuk1")
UP, LIFTS, ROLLS = (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)
# Axis, length (m), mass (kg) of each link, the next joint at its end; a waist stands upright.
WAIST, UPPER, FORE = (UP, 0.12, 1.5), (LIFTS, 0.25, 1.0), (LIFTS, 0.2, 0.6)
TURN, WRIST, TOOL = (ROLLS, 0.1, 0.3), (LIFTS, 0.06, 0.15), (ROLLS, 0.04, 0.1)
ARMS = {
    1: (UPPER,),
    3: (WAIST, UPPER, FORE),
    5: (WAIST, UPPER, FORE, WRIST, TOOL),
    6: (WAIST, UPPER, FORE, TURN, WRIST, TOOL),
    7: (WAIST, UPPER, TURN, FORE, TURN, WRIST, TOOL),
}
SOME_ARMS = [joints if joints in (1, 3, 7) else pytest.param(joints, marks=pytest.mark.slow) for joints in ARMS]
SENSORS = ("potentiometer", "tachometer", "current_sense")
TICKS, SETTLING_TICKS, SUBSTEPS = 1400, 820, 2
CURRENT_A = 1.5


def cell_of(joints: int, sensors: tuple[str, ...] = SENSORS) -> Cell:
    """A cell for an arm of a number of joints: drives that hold it with half their current, as many cards as needed."""
    table = KONKUK.model_dump()
    template = table["robot"][0]["joint"][0]
    names = [f"axis{i + 1}" for i in range(joints)]
    kept = {name: value if name in sensors else None for name, value in template["sensors"].items()}
    origin, built = (0.0, 0.0, 0.0), []
    for name, (axis, length, mass) in zip(names, ARMS[joints], strict=True):
        along = UP if axis == UP else ROLLS
        thin, across = mass * 0.03**2 / 2, mass * (3 * 0.03**2 + length**2) / 12
        body = {
            "origin_m": origin,
            "axis": axis,
            "mass_kg": mass,
            "centre_of_mass_m": tuple(length / 2 * part for part in along),
            "inertia_kg_m2": (*(thin if part else across for part in along), 0.0, 0.0, 0.0),
        }
        origin = tuple(length * part for part in along)
        home = 20.0 if axis == LIFTS else 0.0
        built.append({**template, "name": name, "home_deg": home, "link": None, "body": body, "sensors": kept})
    robot = {**table["robot"][0], "gravity_m_s2": (0.0, 0.0, -9.81), "joint": tuple(built)}
    table |= {"name": f"arm{joints}", "robot": (robot,), "card": tuple(cards_of(names, sensors, table["card"]))}
    cell = Cell.model_validate(table)
    cell = cell.model_copy(update={"robot": (with_drives(cell.robot[0]),)})
    return tuned(cell)


def tuned(cell: Cell) -> Cell:
    """The cell with the gains that are suggested for it."""
    tables = suggested_control(cell)
    nested: dict[str, Any] = dict(tables["control"])
    nested |= {name.removeprefix("control."): table for name, table in tables.items() if "." in name}
    return cell.model_copy(update={"control": Control.model_validate(nested)})


def cards_of(names: list[str], sensors: tuple[str, ...], cards: tuple[dict[str, Any], ...]) -> list[dict[str, Any]]:
    """DAC and latch cards of four channels, ADC cards of eight."""
    signals = {
        "dac": [f"{name}.current_command" for name in names],
        "latch": [f"{name}.direction" for name in names],
        "adc": [f"{name}.{sensor}" for sensor in sensors for name in names],
    }
    found: list[dict[str, Any]] = []
    for card in cards:
        size = 8 if card["name"] == "adc" else 4
        wanted = signals[card["name"]]
        for start in range(0, len(wanted), size):
            slot = len(found) + 1
            channels = [
                {"number": number, "signal": signal} for number, signal in enumerate(wanted[start : start + size], 1)
            ]
            found.append(
                {
                    **card,
                    "name": f"{card['name']}{slot}",
                    "slot": slot,
                    "node_id": 0x10 + slot,
                    "channel": tuple(channels),
                }
            )
    return found


def with_drives(robot: Robot) -> Robot:
    """Motors with which gravity takes at most half of the current, and supplies that suffice at full speed."""
    arm, rng = SerialArm.from_robot(robot), np.random.default_rng(0)
    poses = rng.uniform(-2.2, 2.2, (400, arm.joint_count)).tolist()
    hold_nm = np.abs([arm.gravity(pose) for pose in poses]).max(axis=0)
    links = np.array(arm.effective_inertia) - np.array(arm.rotor_inertia)
    torque_nm = np.maximum(hold_nm, 20.0 * links) / 0.5 + 0.2
    joints = []
    for joint, torque in zip(robot.joint, torque_nm.tolist(), strict=True):
        motor = joint.motor.model_copy(
            update={
                "torque_constant_nm_a": torque / (60.0 * 0.85 * CURRENT_A),
                "rotor_inertia_kg_m2": 1.25e-4 * torque / (60.0 * 0.85),
                "viscous_friction_nm_s": 0.02 * torque / 2.5,
                "coulomb_friction_nm": 0.025 * torque,
            }
        )
        supply_v = 1.1 * (2.5 * motor.back_emf_v_s_rad + CURRENT_A * motor.winding_ohm)
        drive = joint.drive.model_copy(update={"supply_v": max(supply_v, joint.drive.supply_v)})
        joints.append(joint.model_copy(update={"motor": motor, "drive": drive}))
    return robot.model_copy(update={"joint": tuple(joints)})


def pinocchio_of(robot: Robot) -> pinocchio.Model:
    """The robot's bodies in Pinocchio, placed as URDF places them."""
    model, parent = pinocchio.Model(), 0
    model.gravity.linear = np.array(robot.gravity_m_s2)
    for joint in robot.joint:
        body = joint.body
        assert body is not None
        place = pinocchio.SE3(np.eye(3), np.array(body.origin_m))
        turning = pinocchio.JointModelRevoluteUnaligned(np.array(body.axis))
        parent = model.addJoint(parent, turning, place, joint.name)
        tensor = np.diag(body.inertia_kg_m2[:3])
        inertia = pinocchio.Inertia(body.mass_kg, np.array(body.centre_of_mass_m), tensor)
        model.appendBodyToJoint(parent, inertia, pinocchio.SE3.Identity())
    return model


class Plant:
    """The true arm: Pinocchio's, with friction that stops a joint and holds it."""

    def __init__(self, robot: Robot) -> None:
        motors = [joint.motor for joint in robot.joint]
        self.model = pinocchio_of(robot)
        self._data = self.model.createData()
        self._rotor = np.diag([motor.reflected_inertia_kg_m2 for motor in motors])
        self._viscous = np.array([motor.viscous_friction_nm_s for motor in motors])
        self._coulomb = np.array([motor.coulomb_friction_nm for motor in motors])
        self.q = np.radians([joint.home_deg for joint in robot.joint])
        self.v = np.zeros(len(motors))

    def move(self, torque_nm: NDArray[np.float64], step_s: float) -> None:
        """One semi-implicit step: free motion first, then as much friction as it takes to stop, or all of it."""
        upper = np.triu(pinocchio.crba(self.model, self._data, self.q))
        inverse = np.linalg.inv(upper + np.triu(upper, 1).T + self._rotor)
        bias = pinocchio.rnea(self.model, self._data, self.q, self.v, np.zeros_like(self.v))
        free = self.v + step_s * inverse @ (torque_nm - bias - self._viscous * self.v)
        most = step_s * self._coulomb * np.diag(inverse)
        self.v = np.where(np.abs(free) <= most, 0.0, free - np.sign(free) * most)
        self.q = self.q + step_s * self.v


@dataclass(frozen=True)
class Run:
    """True error of each joint in steps of its potentiometer, and cycles in which the amplifiers had too little."""

    rms_lsb: NDArray[np.float64]
    largest_lsb: NDArray[np.float64]
    saturated: list[int]


def follow(cell: Cell, law: str, trajectory: str = "sine", tip_mass: float = 1.0) -> Run:
    """TICKS cycles from rest at home; the last link's true mass is `tip_mass` times what the controller believes."""
    slots, sensors = input_slots(cell, card_nodes(cell)), joint_sensors(cell)
    loop = ControlLoop(cell, slots, LAWS[law], make_trajectory(trajectory, cell))
    plant, joints = Plant(cell.robot[0]), len(cell.joints)
    tip = plant.model.inertias[joints]
    plant.model.inertias[joints] = pinocchio.Inertia(tip_mass * tip.mass, tip.lever, tip_mass * tip.inertia)
    noise = np.random.default_rng(0).normal(0.0, 0.3, (TICKS + 1, 3 * joints))
    per_ampere = np.array(loop.arm.torque_per_ampere)
    current_a = np.zeros(joints)
    errors = np.empty((TICKS, joints))
    steps = np.array([each.position.scale.lsb for each in sensors])

    def code(wired: WiredSensor, value: float, noise_lsb: float) -> int:
        exact = value / wired.scale.step + wired.scale.zero + noise_lsb
        return max(0, min(wired.highest_code, math.floor(exact + 0.5)))

    loop.begin([code(each.position, plant.q[i], noise[TICKS, i]) for i, each in enumerate(sensors)])
    for tick in range(TICKS):
        codes = []
        for place, slot in enumerate(slots):
            wired = sensors[slot.joint].measuring(slot.quantity)
            assert wired is not None
            true = {
                Quantity.POSITION: plant.q[slot.joint] + wired.skew_s * plant.v[slot.joint],
                Quantity.VELOCITY: plant.v[slot.joint],
                Quantity.CURRENT: abs(current_a[slot.joint]),
            }[slot.quantity]
            codes.append(code(wired, float(true), noise[tick, place]))
        loop.measure(codes, tick)
        loop.look_up(tick)
        errors[tick] = (plant.q - np.array(loop.cycle.reference_rad)) / steps
        dac_codes, directions = loop.outputs(loop.torque_nm())
        for _ in range(SUBSTEPS if tick else 0):
            plant.move(current_a * per_ampere, cell.bus.cycle_s / SUBSTEPS)
        signs = np.array([-1.0 if bits == DirectionBits.CLOCKWISE else 1.0 for bits in directions])
        current_a = signs * np.array(dac_codes) * (CURRENT_A / 255)
    settled = errors[SETTLING_TICKS:]
    return Run(np.sqrt((settled**2).mean(axis=0)), np.abs(settled).max(axis=0), loop.saturated_cycles)


@pytest.mark.parametrize("law", [law for law in LAWS if law != "pd"])
@pytest.mark.parametrize("joints", SOME_ARMS)
def test_every_law_with_a_model_follows_within_a_step_of_the_sensor(joints: int, law: str) -> None:
    run = follow(cell_of(joints), law)
    assert run.rms_lsb.max() < 1.0
    assert run.largest_lsb.max() < 3.0
    assert not any(run.saturated)


@pytest.mark.parametrize("joints", SOME_ARMS)
def test_pd_alone_sags_by_what_gravity_and_its_stiffness_say(joints: int) -> None:
    """By G/(J·ωn²) where the joint moves slowly: a yardstick, not a controller for an arm with weight."""
    cell = cell_of(joints)
    arm, omega = SerialArm.from_robot(cell.robot[0]), cell.control.natural_frequency_rad_s
    poses = np.random.default_rng(1).uniform(-0.7, 0.7, (400, joints)) + np.radians([j.home_deg for j in cell.joints])
    sag_rad = np.abs([arm.gravity(pose) for pose in poses.tolist()]).max(axis=0) / arm.effective_inertia / omega**2
    sag_lsb = sag_rad / [each.position.scale.lsb for each in joint_sensors(cell)]
    run = follow(cell, "pd")
    assert np.all(run.rms_lsb < 1.5 * sag_lsb + 4.0)


@pytest.mark.parametrize("law", ["mras", "slotine-li"])
def test_the_trapezoid_is_followed_as_well(law: str) -> None:
    assert follow(cell_of(5), law, "trapezoid").rms_lsb.max() < 1.0


@pytest.mark.parametrize("law", LAWS)
def test_a_joint_without_tachometer_gets_its_speed_from_an_observer(law: str) -> None:
    run = follow(cell_of(3, ("potentiometer",)), law)
    assert run.rms_lsb.max() < (16.0 if law == "pd" else 1.0)


def test_a_payload_on_a_long_arm_is_learned() -> None:
    """The last link of three weighs 30 % more: adaptation takes off most of what the model alone leaves."""
    cell = cell_of(3)
    by_model = follow(cell, "computed-torque", tip_mass=1.3).rms_lsb.max()
    adapted = follow(cell, "slotine-li", tip_mass=1.3).rms_lsb.max()
    assert adapted < 0.5
    assert adapted < 0.25 * by_model


def test_suggested_gains_of_konkuk1_are_its_own() -> None:
    """Which are tried: see docs/ablation.md. Rounded to two digits, so that some differ by 5 %."""
    suggested = suggested_control(KONKUK)
    own = KONKUK.control.model_dump()
    for name, table in suggested.items():
        values = own if name == "control" else own[name.removeprefix("control.")]
        for key, value in table.items():
            assert value == pytest.approx(values[key], rel=0.06), f"{name}.{key}"


def test_a_coarse_sensor_and_a_long_cycle_ask_for_a_slower_arm() -> None:
    slow_bus = KONKUK.bus.model_copy(update={"cycle_us": 10_000})
    slow = suggested_control(KONKUK.model_copy(update={"bus": slow_bus}))["control"]
    assert slow["natural_frequency_rad_s"] == pytest.approx(8.0)
    robot = KONKUK.robot[0]
    joints = []
    for joint in robot.joint:
        sensor = joint.sensors.potentiometer
        assert sensor is not None
        wide = sensor.model_copy(update={"range_deg": 2700.0, "zero_v": 2.5})
        joints.append(joint.model_copy(update={"sensors": joint.sensors.model_copy(update={"potentiometer": wide})}))
    coarse = KONKUK.model_copy(update={"robot": (robot.model_copy(update={"joint": tuple(joints)}),)})
    expected = math.sqrt(0.1 * 1.5 * 4.08 / (0.1104 * math.radians(2700.0 / 255)))
    assert suggested_control(coarse)["control"]["natural_frequency_rad_s"] == pytest.approx(expected, rel=0.05)


OWN_GAINS = """
[[control.joint]]
name = "joint3"
natural_frequency_rad_s = 6.0
damping_ratio = 0.7
"""


@pytest.mark.parametrize("law", ["pd", "computed-torque", "mras", "mras-lyapunov"])
def test_a_joint_may_have_gains_of_its_own(law: str) -> None:
    """Joint 2 moves as with the cell's gains, joint 3 as if its own were everybody's: by the first torques of a law."""
    text = shipped_cells()["konkuk1"].replace("[supervision]", f"{OWN_GAINS}\n[supervision]", 1)
    everywhere = {"control.natural_frequency_rad_s": "6.0", "control.damping_ratio": "0.7"}
    cells = [load_cell("konkuk1"), load_cell("konkuk1", everywhere), parse_cell(text, "own gains")]

    def torques_nm(cell: Cell) -> list[float]:
        arm = nominal_arm(cell.robot[0])
        made = load_law(law)(arm, cell.control, 0.0025)
        made.start([0.1, 0.2], [0.0, 0.0], [0.5, 0.5])
        cycle = Cycle(2)
        cycle.position_rad, cycle.velocity_rad_s = (0.1, 0.2), (0.05, -0.05)
        cycle.reference_rad, cycle.reference_rad_s, cycle.reference_rad_s2 = (0.12, 0.23), (0.1, 0.1), (0.5, 0.5)
        return list(made.update(cycle))

    usual, softer, own = map(torques_nm, cells)
    assert usual[1] != pytest.approx(softer[1], rel=1e-3)
    if law == "computed-torque":  # its torques are coupled through the inertia matrix: D22 of joint 2, D33 of joint 3
        assert own[1] != pytest.approx(usual[1], rel=1e-3)
        return
    assert own == pytest.approx([usual[0], softer[1]], rel=1e-12)


def test_a_joint_may_have_rates_of_its_own_in_slotine_li() -> None:
    """The sliding variable s = ė + Λ·e of each joint has the Λ that the joint has; the adaptation is the arm's."""
    softer = {"control.slotine_li.error_rate_rad_s": "10", "control.slotine_li.sliding_rate_rad_s": "20"}
    own = {key.replace("slotine_li", "joint3.slotine_li"): value for key, value in softer.items()}

    def sliding_rad_s(settings: dict[str, str]) -> list[float]:
        cell = load_cell("konkuk1", settings)
        made = load_law("slotine-li")(nominal_arm(cell.robot[0]), cell.control, 0.0025)
        made.start([0.1, 0.2], [0.0, 0.0], [0.5, 0.5])
        cycle = Cycle(2)
        cycle.position_rad, cycle.velocity_rad_s = (0.1, 0.2), (0.05, -0.05)
        cycle.reference_rad, cycle.reference_rad_s, cycle.reference_rad_s2 = (0.12, 0.23), (0.1, 0.1), (0.5, 0.5)
        made.update(cycle)
        return list(made.internals()["sliding_rad_s"])

    usual, everywhere, mixed = map(sliding_rad_s, ({}, softer, own))
    assert mixed == pytest.approx([usual[0], everywhere[1]], rel=1e-12)
    assert usual[1] != pytest.approx(everywhere[1], rel=1e-3)
