"""Feed-forward from the table and on line: one torque, two ways."""

import numpy as np
import pytest

from canarm_controller.dynamics import NominalArm
from canarm_controller.errors import ControllerError
from canarm_controller.reference.feedforward import Feedforward, make_feedforward
from canarm_controller.reference.memory import MemoryImage
from canarm_controller.reference.trajectory import Reference, make_trajectory
from canarm_protocol.cell.cell_file import load_cell

CELL = load_cell("konkuk1")
ARM = NominalArm.from_robot(CELL.robot[0])
PERIOD_S = 0.0025


def prepared(kind: str, exclude_inertia: bool, first_tick: int = 0, lead_s: float = 0.0) -> Feedforward:
    feedforward = make_feedforward(kind, ARM, MemoryImage(2, ARM.max_current_a), exclude_inertia, lead_s)
    feedforward.prepare(reference(first_tick, 4096), first_tick)
    return feedforward


def reference(first_tick: int, count: int) -> Reference:
    return make_trajectory("sine", CELL).sample(first_tick, count, PERIOD_S)


@pytest.mark.parametrize("exclude_inertia", [False, True])
def test_table_is_the_online_torque_within_half_a_table_step(exclude_inertia: bool) -> None:
    """Half a step of the table is 1.5/255 A, times K_I = 4.08 and 2.72 N·m/A."""
    table, online = prepared("table", exclude_inertia), prepared("online", exclude_inertia)
    difference = np.array([np.subtract(table.torque_nm(k), online.torque_nm(k)) for k in range(4096)])
    bound = np.array([4.08, 2.72]) * 1.5 / 255
    assert (np.abs(difference).max(axis=0) <= bound * (1 + 1e-9)).all()
    assert (np.abs(difference).max(axis=0) > 0.9 * bound).all()


def test_online_is_the_inverse_dynamics_along_the_reference() -> None:
    online = prepared("online", exclude_inertia=False)
    block = reference(0, 4096)
    for k in (0, 17, 4095):
        expected = ARM.torque_nm(block.position_rad[k], block.velocity_rad_s[k], block.acceleration_rad_s2[k])
        assert online.torque_nm(k) == pytest.approx(expected, rel=1e-12)


def test_excluded_inertia_is_effective_inertia_times_acceleration() -> None:
    whole, without = prepared("online", exclude_inertia=False), prepared("online", exclude_inertia=True)
    acceleration = reference(0, 4096).acceleration_rad_s2
    for k in (3, 400, 2000):
        expected = np.array(ARM.effective_inertia) * acceleration[k]
        np.testing.assert_allclose(np.subtract(whole.torque_nm(k), without.torque_nm(k)), expected, rtol=1e-9)


def test_table_is_refilled_for_the_next_10_24_seconds() -> None:
    feedforward = prepared("table", exclude_inertia=False)
    before = [feedforward.torque_nm(k) for k in range(4096)]
    feedforward.prepare(reference(4096, 4096), 4096)
    online = prepared("online", exclude_inertia=False, first_tick=4096)
    after = [feedforward.torque_nm(4096 + k) for k in range(4096)]
    np.testing.assert_allclose(after, [online.torque_nm(4096 + k) for k in range(4096)], atol=4.08 * 1.5 / 255)
    assert np.abs(np.subtract(after, before)).max() > 0.1


def test_lead_gives_the_torque_of_a_later_tick() -> None:
    """Over 2 ticks the reference extrapolated at constant acceleration is off by jerk only: < 1 % of 2 N·m."""
    leading, online = prepared("online", True, lead_s=2 * PERIOD_S), prepared("online", True)
    for k in (300, 1100, 2500):
        np.testing.assert_allclose(leading.torque_nm(k), online.torque_nm(k + 2), atol=0.02)


def test_torque_beyond_the_amplifier_is_counted_not_wrapped() -> None:
    image = MemoryImage(2, (0.1, 0.1))
    feedforward = make_feedforward("table", ARM, image, exclude_inertia=False)
    feedforward.prepare(reference(0, 4096), 0)
    assert feedforward.clipped_samples > 1000
    decoded = [image.table_current_a(0, k) for k in range(4096)]
    assert max(map(abs, decoded)) == pytest.approx(0.1 * 254 / 255)


def test_none_is_zero() -> None:
    assert prepared("none", exclude_inertia=False).torque_nm(5) == (0.0, 0.0)


def test_online_refuses_a_tick_that_is_not_prepared() -> None:
    with pytest.raises(ControllerError, match="tick 4096 is not prepared; ticks 0 to 4095 are"):
        prepared("online", exclude_inertia=False).torque_nm(4096)


def test_table_refuses_a_block_that_straddles_its_boundary() -> None:
    with pytest.raises(ControllerError, match="begins at tick 100; must be a multiple of 4096"):
        prepared("table", exclude_inertia=False, first_tick=100)


def test_table_without_memory_is_refused() -> None:
    with pytest.raises(ControllerError, match="'table' needs a memory image"):
        make_feedforward("table", ARM, None, exclude_inertia=False)


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ControllerError, match="'tabel': no such kind; must be one of none, table, online"):
        make_feedforward("tabel", ARM, None, exclude_inertia=False)
