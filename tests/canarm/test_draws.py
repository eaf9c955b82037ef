"""Robots drawn from the box: every slice of an axis once, the same for the same seed, and within what is stated."""

import math

import numpy as np
import pytest

from canarm import Rig
from canarm.draws import PAYLOAD, Choice, Span, Whole, clopper_pearson, hypercube, retimed, robot_box, truth_of
from canarm_emulator.robot.truth import Truth
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.errors import CellError

COUNT = 40


def test_each_slice_of_an_axis_is_drawn_once() -> None:
    share, factor = Span("share", 0.0, 1.0), Span("factor", 0.25, 4.0, is_factor=True)
    draws = hypercube([share, factor], COUNT, seed=3)
    assert sorted(int(float(draw["share"]) * COUNT) for draw in draws) == list(range(COUNT))
    # Half of all factors are below 1: as many robots lack as have more.
    assert sum(float(draw["factor"]) < 1.0 for draw in draws) == COUNT / 2


def test_every_choice_comes_as_often_as_any_other() -> None:
    draws = hypercube([Choice("law", ("a", "b", "c", "d"))], COUNT, seed=1)
    assert all(sum(draw["law"] == law for draw in draws) == COUNT / 4 for law in "abcd")


def test_the_same_seed_draws_the_same_and_another_axis_changes_nothing() -> None:
    one, two = Span("one", 0.0, 1.0), Whole("two", 0, 99)
    alone, both = hypercube([one], COUNT, seed=5), hypercube([two, one], COUNT, seed=5)
    assert [draw["one"] for draw in alone] == [draw["one"] for draw in both]
    assert alone != hypercube([one], COUNT, seed=6)
    assert {type(draw["two"]) for draw in both} == {int}


def test_a_drawn_robot_lies_within_the_box() -> None:
    cell = load_cell("konkuk1")
    draws = hypercube(robot_box(cell), COUNT, seed=0)
    for draw in draws:
        true = Truth.from_settings(cell, truth_of(cell, draw))
        for nominal, joint in zip(cell.joints, true.joints, strict=True):
            assert 0.3 <= joint.coulomb_friction_nm / nominal.motor.coulomb_friction_nm <= 2.7
            assert 0.9 <= joint.torque_constant_nm_a / nominal.motor.torque_constant_nm_a <= 1.1
            assert 0.15 <= joint.sensors["tachometer_noise_lsb"] <= 0.6
            assert abs(joint.sensors["potentiometer_offset_deg"]) <= 1.0
            assert abs(joint.initial_deg - nominal.home_deg) <= 20.0
            if joint.has_elastic_wire:
                assert 0.5 <= joint.wire_stiffness_nm_rad / nominal.motor.wire_stiffness_nm_rad <= 2.0
        assert 0.3 <= true.joints[-1].mass_kg <= 1.08
        assert true.joints[0].mass_kg == 1.0
    assert sum(draw["joint2.wire"] == "elastic" for draw in draws) == COUNT / 2


def test_an_axis_that_is_not_drawn_is_nominal() -> None:
    cell = load_cell("konkuk1")
    assert truth_of(cell, {}) == {}
    assert truth_of(cell, {PAYLOAD.name: 0.5}) == {"joint3.mass": "0.9"}


@pytest.mark.parametrize("law", ["pd", "slotine-li"])
@pytest.mark.parametrize("cycle_us", [2500, 5000, 7000, 9000])
def test_a_wire_is_drawn_elastic_where_the_sampled_law_damps_its_swing(law: str, cycle_us: int) -> None:
    """Rotor and link on a spring, and the law's torque by the rotor's speed, held for a cycle, a cycle late."""
    cell = retimed(load_cell("konkuk1"), cycle_us)
    control, gains, drawn = cell.control, cell.control.slotine_li, {}
    assert gains is not None
    rates = {
        "pd": 2.0 * control.damping_ratio * control.natural_frequency_rad_s,
        "slotine-li": gains.error_rate_rad_s + gains.sliding_rate_rad_s,
    }
    for factor in np.geomspace(0.5, 2.0, 9):
        truth = truth_of(cell, {"joint2.wire": "elastic", "joint2.wire_stiffness": factor}, law)
        drawn[factor] = "joint2.wire" in truth
        if drawn[factor]:
            assert largest_root(200.0 * factor, 0.054, 0.1102 - 0.054, rates[law] * 0.1102, cycle_us * 1e-6) < 1.0
    assert drawn[0.5] or cycle_us > 8000
    assert all(drawn.values()) == (cycle_us == 2500 or (cycle_us, law) == (5000, "pd"))


def largest_root(stiffness: float, rotor: float, link: float, damping: float, period_s: float) -> float:
    """The greatest magnitude of the sampled swing's eigenvalues. States: twist, speeds, torque that is held."""
    rate = np.zeros((4, 4))
    rate[0, 1:3] = 1.0, -1.0
    rate[1, (0, 3)] = -stiffness / rotor, 1.0 / rotor
    rate[2, 0] = stiffness / link
    step, term = np.eye(4), np.eye(4)
    for power in range(1, 40):  # the exponential's series
        term = term @ rate * (period_s / power)
        step = step + term
    step[3] = 0.0, -damping, 0.0, 0.0
    return float(np.abs(np.linalg.eigvals(step)).max())


@pytest.mark.filterwarnings("ignore:.*does not fit:canarm.rig.arguments.RigWarning")
@pytest.mark.parametrize("cycle_us", [800, 10_000])
def test_a_cell_runs_with_another_cycle(cycle_us: int) -> None:
    with Rig(retimed(load_cell("konkuk1"), cycle_us)) as rig:
        rig.run(seconds=0.1)
        assert rig.detections == []
        assert len(rig.joints["joint2"].time_s) == round(0.1 / (cycle_us * 1e-6))


def test_a_cycle_that_the_scan_does_not_fit_into_is_refused() -> None:
    with pytest.raises(CellError, match="at 600 us"):
        retimed(load_cell("konkuk1"), 600)


@pytest.mark.parametrize(
    ("hits", "count", "low", "high"),
    [
        # 0 of n: 1 - 0.025^(1/n). The others: R's binom.test(hits, count).
        (0, 100, 0.0, 1.0 - 0.025 ** (1.0 / 100.0)),
        (0, 3000, 0.0, 1.0 - 0.025 ** (1.0 / 3000.0)),
        (1, 20, 0.001265089, 0.2487328),
        (7, 20, 0.1539092, 0.5921885),
        (20, 20, 0.025 ** (1.0 / 20.0), 1.0),
    ],
)
def test_the_bounds_of_a_proportion_are_those_of_clopper_and_pearson(
    hits: int, count: int, low: float, high: float
) -> None:
    assert clopper_pearson(hits, count) == pytest.approx((low, high), rel=1e-6)
    assert all(math.isfinite(bound) for bound in clopper_pearson(hits, count, 0.99))
