"""A payload that the amplifier cannot hold: said, limited, not wound up, and got over."""

import math

import numpy as np
import pytest

from canarm import Rig
from canarm.rig.rig import State
from tests.hooked_law import hook_law

HEAVY_KG, NOMINAL_KG = 2.1, 0.6
LIMIT_A = 1.5
SINE_PERIOD_S = 2.56  # of joint 2
LSB_RAD = math.radians(270 / 255)


def static_current_a(mass_kg: float) -> float:
    """Current that holds the stretched arm level: G2 = (m2/2 + 3/2 m3) g L, over K_I of joint 2."""
    length_m, gravity, first_kg, k_i = 0.18, 9.8062, 1.0, 0.08 * 60 * 0.85
    return (0.5 * first_kg + 1.5 * mass_kg) * gravity * length_m / k_i


@pytest.fixture(scope="module")
def overloaded():
    """A rig that has run 5.12 s overloaded, with the law's internals of every tick and whether it saturated before."""
    with Rig("konkuk1", law="mras", truth={"joint3.mass": HEAVY_KG}) as rig:
        rows = []
        loop = rig.controller.loop
        cycle, law = loop.cycle, loop.law

        def watched(given):
            saturated = list(given.saturated)
            before = {name: list(values) for name, values in law.internals().items()}
            torque = law.update(given)
            rows.append((saturated, before, {name: list(values) for name, values in law.internals().items()}))
            return torque

        hook_law(loop, watched)
        rig.run(5.12)
        loop.law = law
        assert cycle.tick == 2047
        yield rig, rows


def test_the_payload_needs_more_than_the_amplifier_has() -> None:
    assert static_current_a(HEAVY_KG) == pytest.approx(1.579, abs=5e-4)
    assert static_current_a(HEAVY_KG) > LIMIT_A > static_current_a(0.9) == pytest.approx(0.800, abs=5e-4)


def test_the_current_never_exceeds_the_amplifier(overloaded) -> None:
    rig, _ = overloaded
    for joint in rig.joints.values():
        assert np.abs(joint.current_a).max() <= LIMIT_A + 1e-12
        assert np.abs(joint.command_a).max() <= LIMIT_A + 1e-12
    assert rig.joints["joint2"].peak_current_a == pytest.approx(LIMIT_A, rel=1e-3)


def test_the_summary_says_that_the_amplifier_is_at_its_limit(overloaded) -> None:
    rig, _ = overloaded
    summary = rig.summary()
    at_limit = np.count_nonzero(np.abs(rig.joints["joint2"].command_a) >= LIMIT_A * (1 - 1e-9))
    assert summary.joints["joint2"].saturated_cycles == at_limit > 1000
    assert summary.joints["joint3"].saturated_cycles == 0
    assert f"saturated in {at_limit} cycles" in summary.as_text()
    assert summary.as_json()["joints"]["joint2"]["saturated_cycles"] == at_limit
    assert summary.joints["joint2"].rms_lsb > 10.0  # and it does not follow
    assert rig.state is State.RUNNING


def test_adaptation_and_bias_stand_still_while_the_amplifier_saturates(overloaded) -> None:
    rig, rows = overloaded
    frozen = 0
    for saturated, before, after in rows:
        for joint in range(2):
            if saturated[joint]:
                frozen += 1
                assert all(before[name][joint] == after[name][joint] for name in ("alpha", "beta", "bias_a"))
    assert frozen > 1000
    a, b = 1 / 12**2, 2 / 12  # the model: 1/wn^2 and 2*zeta/wn
    for _, _, after in rows:
        assert max(map(abs, after["bias_a"])) <= rig.cell.control.mras.bias_limit_a == 0.6
        assert all(0.35 * a <= alpha <= 3 * a for alpha in after["alpha"])
        assert all(0.35 * b <= beta <= 3 * b for beta in after["beta"])


def test_the_arm_recovers_within_a_period_when_the_payload_is_dropped() -> None:
    with Rig("konkuk1", law="mras", truth={"joint3.mass": HEAVY_KG}) as rig:
        rig.run(5.12)
        dropped = len(rig.joints["joint2"].true_angle_rad)
        rig.change_truth("joint3.mass", NOMINAL_KG)
        rig.run(3 * SINE_PERIOD_S)
        period = round(SINE_PERIOD_S / 0.0025)
        for joint in rig.joints.values():
            error = ((joint.true_angle_rad - joint.reference_rad) / LSB_RAD)[dropped:]
            assert math.sqrt(np.mean(error[period : 2 * period] ** 2)) <= 0.35
            assert np.abs(joint.command_a[dropped + period :]).max() < LIMIT_A
        assert rig.state is State.RUNNING
        assert [event.event for event in rig.events if event.event == "truth"] == ["truth"]
