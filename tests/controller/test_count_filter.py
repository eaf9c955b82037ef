"""A joint between two counts: by motions whose law is known, of which the filter is only told the counts."""

import math
import random

import pytest

from canarm_controller.supervision.count_filter import CountFilter

T = 0.0025
STEP = math.radians(1.0) / 8.7
FRICTION = 0.95


def followed(speeds_rad_s: list[float], model_rad_s2: list[float]) -> tuple[CountFilter, list[tuple[float, float]]]:
    """The filter after a motion, and its error and deviation ahead of every count that continues in one way."""
    found = CountFilter(STEP, T, FRICTION)
    angle, code, before, cycles = 0.4 * STEP, 0, 0.0, 0
    errors = []
    for speed, model in zip(speeds_rad_s, model_rad_s2, strict=True):
        angle += T * speed
        cycles += 1
        found.step(model)
        moved = math.floor(angle / STEP) - code
        if not moved:
            continue
        way, edge = math.copysign(1.0, moved), STEP * (code + (moved > 0))
        if way == before:
            errors.append((found.position_rad - angle, found.deviation_rad(cycles, way)))
            found.count(edge, way, cycles, abs(moved) == 1)
        else:
            found.begin(edge)
        before, code, cycles = way, code + moved, 0
    return found, errors


def swing(load: float, friction: float, seconds: float = 20.0) -> tuple[CountFilter, list[tuple[float, float]]]:
    """To and fro, 25 counts and more; the model knows the acceleration but for a load and some friction, rad/s²."""
    speeds, models = [], []
    for cycle in range(round(seconds / T)):
        phase = 2.0 * math.pi * cycle * T / 5.0
        speed = 0.08 * math.cos(phase)
        speeds.append(speed)
        models.append(-0.08 * 2.0 * math.pi / 5.0 * math.sin(phase) - load - friction * math.copysign(1.0, speed))
    return followed(speeds, models)


def test_after_some_counts_at_an_even_speed_the_joint_is_known_to_what_it_turns_in_a_cycle() -> None:
    found, errors = followed([0.07] * 800, [0.0] * 800)
    assert found.speed_rad_s == pytest.approx(0.07, rel=0.02)
    assert max(abs(error) for error, _ in errors[30:]) < 0.07 * T


def test_what_is_lacking_of_load_and_of_friction_is_told_apart_by_the_ways_that_the_joint_turns() -> None:
    found, _ = swing(load=0.15, friction=-0.2)
    assert found.load == pytest.approx(0.15, abs=0.05)
    assert found.friction == pytest.approx(-0.2, abs=0.06)


def test_it_knows_how_well_it_knows() -> None:
    """Of robots drawn from what it expects, at most 5 in 1000 counts come beyond 5 deviations, and few beyond 3."""
    draw = random.Random(1)
    errors = []
    for _ in range(12):
        errors += swing(draw.uniform(-0.4, 0.4), draw.uniform(-0.3, 0.3) * FRICTION, 10.0)[1]
    off = [abs(error) / deviation for error, deviation in errors]
    assert len(off) > 800
    assert sum(each > 5.0 for each in off) <= len(off) * 5 // 1000
    assert sum(each > 3.0 for each in off) < len(off) // 20
    assert sum(each > 0.1 for each in off) > len(off) // 4
