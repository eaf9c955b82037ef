"""Another object than the cell's: the slave is parked where it then holds it, or the reason why it cannot be."""

import math

import numpy as np
import pytest

from canarm import Rig, State
from canarm.cooperation import CarriedObject, forward, pair_of
from canarm.open_cell import open_cell
from canarm.soundness import unsound
from canarm_controller.reference.trajectory import make_trajectory
from canarm_protocol.cell import Cell
from canarm_protocol.errors import CellError


def hands_apart_m(cell: Cell, distance_m: float) -> float:
    """From the slave's hand at home to the point of the object that it is to hold, by forward kinematics."""
    master, slave = cell.robot
    pair = pair_of(master, slave, CarriedObject(length_m=2.0, grasp_distance_m=distance_m))
    tips = [
        forward(arm, np.radians([joint.home_deg for joint in robot.joint]))
        for arm, robot in ((pair.master, master), (pair.slave, slave))
    ]
    return math.dist(pair.carried.frame(tips[0])[:3, 3], (pair.base_transform @ tips[1])[:3, 3])


@pytest.mark.parametrize("length_m", [0.2, 0.45, 0.6, 0.8, 1.0])
def test_the_slave_is_parked_at_the_middle_of_an_object_of_any_length(length_m: float) -> None:
    cell = open_cell("rhino-pair", {"object.length_m": str(length_m)})
    assert cell.object is not None
    assert cell.object.grasp_distance_m == length_m / 2
    assert hands_apart_m(cell, length_m / 2) < 1e-8
    assert not list(unsound(cell))
    first = make_trajectory("circle", cell).sample(0, 1, cell.bus.cycle_s).position_rad[0]
    np.testing.assert_allclose(np.degrees(first), [joint.home_deg for joint in cell.joints], atol=1e-5)


def test_where_it_holds_the_object_is_a_key_of_its_own() -> None:
    cell = open_cell("rhino-pair", {"object.length_m": "0.9", "object.grasp_distance_m": "0.25"})
    assert hands_apart_m(cell, 0.25) < 1e-8
    heavy = open_cell("rhino-pair", {"object.mass_kg": "0.7"})
    assert heavy.object is not None
    assert heavy.object.mass_kg == 0.7
    assert hands_apart_m(heavy, 0.3) < 1e-8


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"object.length_m": "1.4"}, "with --set object.length_m=1.4: slave, pose 0: out of reach: B is at"),
        ({"object.theta_x_deg": "200"}, "with --set object.theta_x_deg=200: slave, pose 0: out of reach"),
        ({"object.grasp_distance_m": "0.7"}, "object.grasp_distance_m = 0.7: is beyond the object's end"),
        ({"object.mass_kg": "-1"}, "object.mass_kg = -1: must be greater than 0"),
        ({"object.mas_kg": "1"}, "object.mas_kg=1: no such key (see `canarm check --keys`); did you mean 'mass_kg'?"),
    ],
)
def test_an_object_that_cannot_be_carried_is_refused_with_the_reason(settings: dict[str, str], message: str) -> None:
    with pytest.raises(CellError) as refused:
        open_cell("rhino-pair", settings)
    assert message in str(refused.value)


def test_a_cell_in_which_nothing_is_carried_says_so() -> None:
    with pytest.raises(
        CellError, match=r"--set object.mass_kg=1: nothing is carried in this cell, it has no \[object\]"
    ):
        open_cell("konkuk1", {"object.mass_kg": "1"})


@pytest.mark.parametrize(
    "settings",
    [
        {"object.length_m": 0.9, "object.mass_kg": 0.5},
        pytest.param({"object.length_m": 0.4}, marks=pytest.mark.slow),
    ],
)
def test_another_object_is_carried_as_well(settings: dict[str, float]) -> None:
    with Rig("rhino-pair", settings=settings) as rig:
        rig.run(seconds=4.5)
        assert rig.state is State.RUNNING
        assert not rig.detections
        assert rig.object.is_held
        assert rig.object.grip_force_n.max() < rig.object.slip_force_n / 2
