"""Brakes against the arithmetic of their circuits and springs: konkuk1's arm with a spring at joint 2, and joint 3
shorted over 2.5 + 3.9 ohm.
"""

import dataclasses
import math
from collections.abc import Callable
from random import Random

import pytest

from canarm_emulator.faults.catalogue import make_fault
from canarm_emulator.faults.declaration import Context, JointFault, TapKind
from canarm_emulator.faults.taps import taps_of
from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import World
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.cell_file import load_cell, parse_cell, shipped_cells
from canarm_protocol.cell.model import Cell, Quantity
from canarm_protocol.faults.script import FaultSpec

SHIPPED, PLAIN = load_cell("konkuk1-brakes"), load_cell("konkuk1")
CELL = parse_cell(
    shipped_cells()["konkuk1-brakes"].replace(
        'brake = { kind = "spring", torque_nm = 2.0, delay_ms = 10.0, release_ms = 15.0 }',
        'brake = { kind = "dynamic", resistor_ohm = 3.9 }',
    ),
    "a test",
)
LEVEL = {"joint2.initial_deg": "0", "joint3.initial_deg": "0"}
MS = 1_000_000
G2_NM, G3_NM = 2.4712, 0.5295  # (m2/2 + m3 + m3/2) g L and m3/2 g L, level, L = 0.18 m and g = 9.8062 m/s2
COULOMB2_NM, COULOMB3_NM, VISCOUS3_NM_S = 0.15, 0.06, 0.02  # konkuk1.toml
TORQUE_NM_A = 4.08  # K_I of joint 2
DAMPING_NM_S = 2.72 * 3.2 / (2.5 + 3.9)  # K_I K_e / (R + R_b) of joint 3
SPRING_NM = 5.0  # konkuk1-brakes.toml


def world_of(cell: Cell = CELL, settings: dict[str, str] = LEVEL) -> World:
    return World(cell, Truth.from_settings(cell, settings), 0)


def ask(world: World, *amperes: float) -> None:
    for joint, current_a in enumerate(amperes):
        world.set_dac_output(joint, abs(current_a) / 1.5 * 255 / 256)
        world.set_direction(joint, DirectionBits.COUNTER_CLOCKWISE if current_a >= 0 else DirectionBits.CLOCKWISE)


def let_pass(world: World, milliseconds: float) -> None:
    world.advance(world.time_ns + round(milliseconds * MS))


def with_fault(world: World, name: str, **parameters: float) -> None:
    """Both brakes have it from now on."""
    joints = []
    for joint, true in enumerate(world.truth.joints):
        tap = taps_of(CELL)[f"{CELL.joint_names[joint]}.brake"]
        fault = make_fault(taps_of(CELL), FaultSpec(tap.name, name, parameters))
        fault.begin(Context(tap, world.time_ns, CELL.bus.cycle_ns, Random(0)))
        assert isinstance(fault, JointFault)
        joints.append(fault.change(true, world.time_ns))
    world.change(dataclasses.replace(world.truth, joints=tuple(joints)))


def held_up(milliseconds: float = 100) -> World:
    """Currents that carry the level arm, for a while: brakes are released."""
    world = world_of()
    ask(world, G2_NM / TORQUE_NM_A, G3_NM / 2.72)
    let_pass(world, milliseconds)
    return world


def test_only_a_joint_with_a_brake_has_its_tap() -> None:
    braked = [tap.name for tap in taps_of(CELL).values() if tap.kind is TapKind.BRAKE]
    assert braked == ["joint2.brake", "joint3.brake"]
    assert not any(tap.kind is TapKind.BRAKE for tap in taps_of(PLAIN).values())
    assert world_of(PLAIN).brakes_engaged == [None, None]


def test_brakes_are_engaged_without_power_and_released_when_current_is_asked_for() -> None:
    world = world_of()
    assert world.brakes_engaged == [True, True]
    ask(world, 0.6, 0.2)
    let_pass(world, 19)
    assert world.brakes_engaged == [True, False]
    let_pass(world, 2)
    assert world.brakes_engaged == [False, False]


@pytest.mark.parametrize(
    "stop",
    [
        lambda world, joint: world.set_dac_output(joint, 0.0),
        lambda world, joint: world.set_direction(joint, DirectionBits.OFF),
        lambda world, joint: world.set_direction(joint, 0b11),
        lambda world, joint: world.set_supply(joint, False),
    ],
    ids=["no current", "bridge off", "both directions", "supply open"],
)
def test_brakes_engage_when_no_current_is_asked_for_after_their_delay(stop: Callable[[World, int], None]) -> None:
    world = held_up()
    for joint in range(2):
        stop(world, joint)
    seen = []
    for milliseconds in (9, 2, 3, 2):
        let_pass(world, milliseconds)
        seen.append(world.brakes_engaged)
    assert seen == [[False, False], [False, True], [False, True], [True, True]]  # at 9, 11, 14, 16 ms; 10 and 15 ms


def test_a_current_that_passes_zero_engages_nothing() -> None:
    world = held_up()
    for _ in range(20):
        ask(world, 0.0, 0.0)
        let_pass(world, 7.5)
        ask(world, 0.6, 0.2)
        let_pass(world, 2.5)
        assert world.brakes_engaged == [False, False]


def test_a_shorted_motor_lets_its_link_sink_as_fast_as_gravity_drives_its_back_emf() -> None:
    world = world_of()
    ask(world, 0.0, 0.0)
    let_pass(world, 150)
    joint2, joint3 = world.state()
    expected = -(G3_NM - COULOMB3_NM) / (DAMPING_NM_S + VISCOUS3_NM_S)
    assert joint3.speed_rad_s == pytest.approx(expected, rel=0.01)
    assert joint3.current_a == pytest.approx(-3.2 * joint3.speed_rad_s / 6.4, rel=0.01)
    assert abs(joint2.speed_rad_s) < 1e-3


def test_the_current_sense_before_the_bridge_does_not_see_a_brakes_current() -> None:
    world = world_of(settings={**LEVEL, "joint3.noise_lsb": "0"})
    ask(world, 0.0, 0.0)
    let_pass(world, 150)
    assert abs(world.state()[1].current_a) > 0.1
    assert world.sample(world.source(1, Quantity.CURRENT)) == 0.0


def test_a_dynamic_brake_takes_energy_out_of_the_arm_and_puts_none_in() -> None:
    world = held_up()
    ask(world, 0.0, 0.0)
    let_pass(world, 20)
    for _ in range(1000):
        let_pass(world, 0.5)
        joint3 = world.state()[1]
        assert joint3.current_a * joint3.speed_rad_s <= 0.0


def test_a_spring_stops_a_moving_joint_and_holds_it() -> None:
    world = held_up()
    ask(world, 1.2, 0.3)
    let_pass(world, 60)
    assert world.state()[0].speed_rad_s > 0.5
    ask(world, 0.0, 0.0)
    let_pass(world, 100)
    stopped_rad = world.state()[0].angle_rad
    let_pass(world, 2000)
    assert world.state()[0].angle_rad == pytest.approx(stopped_rad, abs=1e-3)


def test_an_engaged_spring_goes_on_holding_when_a_payload_is_hung_on() -> None:
    world = world_of()
    ask(world, 0.0, 0.0)
    let_pass(world, 50)
    joints = [*world.truth.joints]
    joints[1] = dataclasses.replace(joints[1], payload_kg=0.3)  # 0.3 g 0.36 = 1.06 N m more: 3.53 of 5
    world.change(dataclasses.replace(world.truth, joints=tuple(joints)))
    let_pass(world, 200)
    assert abs(world.state()[0].speed_rad_s) < 1e-3


@pytest.mark.parametrize(("share", "holds"), [(0.5, True), (0.45, False)])  # 5 N m of spring, 2.32 N m to be held
def test_a_spring_that_slips_holds_its_share_of_the_torque(share: float, holds: bool) -> None:
    assert 0.45 * SPRING_NM < G2_NM - COULOMB2_NM < 0.5 * SPRING_NM
    world = world_of()
    with_fault(world, "slips", share=share)
    ask(world, 0.0, 0.0)
    let_pass(world, 100)
    assert (abs(world.state()[0].speed_rad_s) < 1e-3) is holds


def test_a_dynamic_brake_that_slips_lets_the_link_sink_faster_by_its_share() -> None:
    world = world_of()
    with_fault(world, "slips", share=0.5)
    joints = [*world.truth.joints]
    joints[0] = dataclasses.replace(joints[0], brake_slip=0.0)
    world.change(dataclasses.replace(world.truth, joints=tuple(joints)))
    ask(world, 0.0, 0.0)
    let_pass(world, 150)
    expected = -(G3_NM - COULOMB3_NM) / (0.5 * DAMPING_NM_S + VISCOUS3_NM_S)
    assert world.state()[1].speed_rad_s == pytest.approx(expected, rel=0.04)  # it has sunk by 5 degrees


def test_brakes_that_do_not_engage_are_as_none() -> None:
    braked, plain = world_of(), world_of(PLAIN)
    with_fault(braked, "does-not-engage")
    for world in (braked, plain):
        ask(world, 0.0, 0.0)
        let_pass(world, 200)
    assert braked.state() == plain.state()
    assert braked.brakes_engaged == [True, True]


def test_a_spring_that_drags_takes_its_share_of_the_torque_from_the_motor() -> None:
    world = held_up()
    with_fault(world, "drags", share=0.3)
    ask(world, (G2_NM + 1.2) / TORQUE_NM_A, G3_NM / 2.72)  # less than 0.3 of 5 N m, and 0.15 of friction
    let_pass(world, 100)
    assert abs(world.state()[0].speed_rad_s) < 1e-3
    ask(world, (G2_NM + 2.2) / TORQUE_NM_A, G3_NM / 2.72)
    let_pass(world, 100)
    assert world.state()[0].speed_rad_s > 0.1


def test_a_contact_that_stays_closed_takes_its_share_of_the_amplifiers_current() -> None:
    world = held_up()
    with_fault(world, "drags", share=1.0)
    joints = [*world.truth.joints]
    joints[0] = dataclasses.replace(joints[0], brake_drag=0.0)
    world.change(dataclasses.replace(world.truth, joints=tuple(joints)))
    ask(world, G2_NM / TORQUE_NM_A, 0.8)
    let_pass(world, 5)
    joint3 = world.state()[1]  # of 0.8 A, 2.5 / 6.4 pass the winding by; and it is a generator
    assert joint3.current_a == pytest.approx(0.8 * 3.9 / 6.4 - 3.2 * joint3.speed_rad_s / 6.4, rel=0.02)


def fastest_without_torque(cell: Cell, moment_s: float, window_s: float) -> float:
    """The highest speed of any joint that is on konkuk1's sine at a moment, and from then on without torque."""
    world = world_of(cell, {})
    ask(world, 0.6, 0.2)
    let_pass(world, 30)  # brakes are released
    angles_rad, speeds_rad_s = [], []
    for middle_deg, amplitude_deg, period_s in ((20.0, 35.0, 2.56), (0.0, 30.0, 1.7)):
        phase = 2.0 * math.pi * moment_s / period_s
        angles_rad.append(math.radians(middle_deg + amplitude_deg * math.sin(phase)))
        speeds_rad_s.append(math.radians(amplitude_deg) * 2.0 * math.pi / period_s * math.cos(phase))
    world._plant.set_state(angles_rad, speeds_rad_s)
    ask(world, 0.0, 0.0)
    fastest_rad_s = 0.0
    for _ in range(round(window_s / 0.0025)):
        let_pass(world, 2.5)
        fastest_rad_s = max(fastest_rad_s, *(abs(joint.speed_rad_s) for joint in world.state()))
    return fastest_rad_s


MOMENTS_S = [(number + 0.5) * 43.52 / 96 for number in range(96)]  # 43.52 s: a common period of 2.56 s and 1.7 s


def test_without_brakes_a_fifth_of_the_moments_pass_3_rad_s_within_100_ms_of_torque_off() -> None:
    share = sum(fastest_without_torque(PLAIN, moment_s, 0.1) > 3.0 for moment_s in MOMENTS_S) / len(MOMENTS_S)
    assert share == pytest.approx(0.19, abs=0.03)


def test_with_brakes_no_moment_of_the_sine_ever_passes_3_rad_s_without_torque() -> None:
    assert max(fastest_without_torque(SHIPPED, moment_s, 0.5) for moment_s in MOMENTS_S) < 3.0
