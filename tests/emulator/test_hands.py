"""Hands at an object on its stand: nothing holds it until both close, then the weight comes into them evenly."""

import dataclasses

import numpy as np
import pytest

from canarm_emulator.robot.carried import ObjectState
from canarm_emulator.robot.hands import TOUCH, Hand, Hands
from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import DirectionBits, World
from canarm_protocol.cell import load_cell
from canarm_protocol.cell.wiring import HandBits

CELL = load_cell("rhino-pair", {"object.on_stand": "true"})
MASTER, SLAVE = sorted(CELL.hands)
WEIGHT_N = 0.4 * 9.8062
MS = 1_000_000
CLOSING_MS, SINKING_MS = 500, 500
FRICTION = {f"{name}.coulomb": "100" for name in CELL.joint_names}
"""So much that arms stand where they are parked."""


def state(world: World) -> ObjectState:
    found = world.object
    assert found is not None
    return found


def stiff_world(**truth: str) -> World:
    """Off its supports."""
    world = World(CELL, Truth.from_settings(CELL, FRICTION | truth), 0)
    world.set_direction(0, DirectionBits.COUNTER_CLOCKWISE)
    return world


def told(world: World, bits: HandBits, *joints: int, ms: int) -> World:
    for joint in joints:
        world.set_grip(joint, bits)
    for _ in range(ms):
        world.advance(world.time_ns + MS)
    return world


def upwards_n(world: World) -> float:
    found = state(world)
    return found.master_force_n[2] + found.slave_force_n[2]


def test_it_waits_on_its_stand_where_the_hands_are_at_home() -> None:
    held = World(load_cell("rhino-pair"), Truth.from_settings(CELL), 0)
    waits = state(stiff_world(**{"master_shoulder.initial_deg": "-79.8"}))
    assert waits.position_m == pytest.approx(state(held).position_m, abs=1e-12)
    assert waits.is_on_stand
    assert waits.lost == ()
    assert not waits.is_in_master
    assert waits.master_force_n == waits.slave_force_n == (0.0, 0.0, 0.0)


def test_the_weight_comes_into_the_hands_as_the_stand_sinks() -> None:
    world = told(stiff_world(), HandBits.CLOSE, MASTER, SLAVE, ms=CLOSING_MS + SINKING_MS // 2)
    assert state(world).is_on_stand
    assert upwards_n(world) == pytest.approx(WEIGHT_N / 2, rel=0.06)  # the pads lag by 10 ms, a fiftieth of the way
    told(world, HandBits.KEEP, MASTER, SLAVE, ms=SINKING_MS)
    assert upwards_n(world) == pytest.approx(WEIGHT_N, abs=1e-3)
    assert not state(world).is_on_stand
    assert state(world).lost == ()


@pytest.mark.parametrize("joint", [MASTER, SLAVE])
def test_one_hand_alone_takes_nothing(joint: int) -> None:
    world = told(stiff_world(), HandBits.CLOSE, joint, ms=3 * CLOSING_MS)
    found = state(world)
    assert found.is_on_stand
    assert not found.is_in_master
    assert not found.is_in_slave
    assert upwards_n(world) == 0.0


def test_a_hand_that_is_not_at_it_closes_on_nothing_and_may_try_again() -> None:
    """5 degrees of the waist are more than its diameter, 30 mm, at a tip 0.5 m away."""
    world = stiff_world(**{"slave_waist.initial_deg": "5"})
    told(world, HandBits.CLOSE, MASTER, SLAVE, ms=3 * CLOSING_MS)
    assert state(world).is_on_stand
    assert not state(world).is_in_master
    angle = world._plant.angle
    angle[5] = 0.0
    world._plant.set_state(angle, [0.0] * len(angle))
    told(world, HandBits.OPEN, SLAVE, ms=CLOSING_MS)
    told(world, HandBits.CLOSE, SLAVE, ms=CLOSING_MS)
    assert state(world).is_in_slave


def test_hands_close_while_robots_are_still_parked() -> None:
    world = told(World(CELL, Truth.from_settings(CELL), 0), HandBits.CLOSE, MASTER, SLAVE, ms=CLOSING_MS + 2)
    assert world.parked
    assert state(world).is_in_master
    assert state(world).position_m == pytest.approx(state(stiff_world()).position_m, abs=1e-9)


def test_calibration_errors_begin_as_no_force() -> None:
    """Where both hands stand off, they hold it as it lies: 2 mm of the slave's base make no force."""
    world = told(stiff_world(**{"object.base_x": "0.002"}), HandBits.CLOSE, MASTER, SLAVE, ms=CLOSING_MS + 20)
    assert abs(state(world).squeeze_n) < 0.02


def test_without_current_a_hand_keeps_what_it_has() -> None:
    hand = Hand(1.0, 0.5)
    hand.bits = HandBits.CLOSE
    hand.move(0.2)
    for bits in (HandBits.KEEP, HandBits.ILLEGAL):
        hand.bits = bits
        hand.move(1.0)
        assert hand.opening == pytest.approx(0.6)
        assert not hand.moves


def test_pads_hold_from_their_touch_on_and_ever_more_firmly() -> None:
    assert CELL.object is not None
    hands = Hands(CELL.object)
    for hand in hands.each.values():
        hand.bits = HandBits.CLOSE
    assert hands.move(0.5 * (1.0 - TOUCH) - 1e-6) == ()
    assert hands.move(2e-6) == ("master", "slave")
    hands.each["slave"].bits = HandBits.KEEP
    hands.move(0.05)
    assert hands.firmness == pytest.approx(0.0, abs=1e-4)  # that of the hand that is less closed
    hands.each["slave"].bits = HandBits.CLOSE
    hands.move(0.05)
    assert hands.firmness == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize(("joint", "lost"), [(MASTER, ("master", "slave")), (SLAVE, ("slave",))])
def test_a_hand_that_is_told_to_open_loses_it(joint: int, lost: tuple[str, ...]) -> None:
    world = told(stiff_world(), HandBits.CLOSE, MASTER, SLAVE, ms=CLOSING_MS + SINKING_MS + 50)
    told(world, HandBits.OPEN, joint, ms=round(CLOSING_MS * TOUCH) - 5)
    assert state(world).lost == ()
    told(world, HandBits.OPEN, joint, ms=10)
    assert state(world).lost == lost


@pytest.mark.parametrize("ms", [10, CLOSING_MS - 20, CLOSING_MS + SINKING_MS // 2, CLOSING_MS + SINKING_MS + 50])
def test_what_happens_to_a_joint_changes_nothing_between_the_hands(ms: int) -> None:
    """The arms are made anew when a friction changes: on the stand, half held, half borne, held."""
    world, other = (told(stiff_world(), HandBits.CLOSE, MASTER, SLAVE, ms=ms) for _ in range(2))
    first, *rest = other.truth.joints
    changed = dataclasses.replace(first, coulomb_friction_nm=101.0)
    other.change(dataclasses.replace(other.truth, joints=(changed, *rest)))
    for each in (world, other):
        told(each, HandBits.CLOSE, MASTER, SLAVE, ms=100)
    np.testing.assert_allclose(state(other).position_m, state(world).position_m, atol=1e-9)
    np.testing.assert_allclose(state(other).master_force_n, state(world).master_force_n, atol=1e-3)
    assert state(other)[5:] == state(world)[5:]
