"""The payload, as far as torques tell that the model lacks."""

import math

import pytest

from canarm_controller.dynamics import cell_arm
from canarm_controller.supervision.load import Load
from canarm_protocol.cell.cell_file import load_cell

G, LENGTH_M, M3_KG, MOST = 9.8062, 0.18, 0.6, 0.8  # the box has up to 80 % more
STRETCHED = (0.0, 0.0)


@pytest.fixture
def load() -> Load:
    cell = load_cell("konkuk1")
    found = Load.of(cell, cell_arm(cell.robot, cell.joint_names))
    assert found is not None
    return found


def weight_nm(more_kg: float) -> tuple[float, float]:
    """What a link that is so much heavier asks of joints 2 and 3, stretched out: at 1.5 and 0.5 lengths."""
    return 1.5 * LENGTH_M * G * more_kg, 0.5 * LENGTH_M * G * more_kg


@pytest.mark.parametrize("more", [-0.4, 0.3, 0.6])
def test_a_heavier_link_is_told_by_its_weight(load: Load, more: float) -> None:
    assert load.share(STRETCHED, weight_nm(more * M3_KG)) * MOST == pytest.approx(more, abs=0.05)


def test_friction_alone_is_hardly_a_payload(load: Load) -> None:
    """1.7 times the nominal Coulomb friction of joint 3, which is off by that at most, and nothing at joint 2."""
    assert abs(load.share(STRETCHED, (0.0, 1.7 * 0.06))) * MOST < 0.1


def test_an_arm_that_hangs_tells_nothing(load: Load) -> None:
    assert load.share((-math.pi / 2, 0.0), (0.3, 0.1)) == pytest.approx(0.0, abs=1e-3)


def test_a_payload_has_the_inertia_of_its_link(load: Load) -> None:
    """Parallel axes: a rod has m L²/3 about its joint, and m (L²/12 + 2.25 L²) about the joint before it."""
    more_kg = 0.6 * M3_KG
    lacking_nm = weight_nm(more_kg)
    found_kg = load.share(STRETCHED, lacking_nm) * MOST * M3_KG
    (first, _), (coupling, second) = load.inertia(STRETCHED, lacking_nm)
    assert second == pytest.approx(found_kg * LENGTH_M**2 / 3.0, rel=1e-3)
    assert first == pytest.approx(found_kg * LENGTH_M**2 * (1.0 / 12.0 + 2.25), rel=1e-3)
    assert coupling == pytest.approx(found_kg * LENGTH_M**2 * (1.0 / 12.0 + 0.75), rel=1e-3)


def test_robots_that_may_share_an_object_have_none() -> None:
    cell = load_cell("rhino-pair")
    assert Load.of(cell, cell_arm(cell.robot, cell.joint_names)) is None
