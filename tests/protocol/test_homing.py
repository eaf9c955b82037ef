"""The index of an encoder: what a count latched at its pulse makes of the scale, and cells that cannot be homed."""

import math

import numpy as np
import pytest

from canarm_protocol.cell import load_cell
from canarm_protocol.cell.cell_checks import problems
from canarm_protocol.cell.homing import homing_problems, index_marks
from canarm_protocol.errors import CellError
from tests.resolutions import cell_of_encoders, homed

CELL = load_cell("rhino-pair")


def test_the_pulses_of_the_pair_come_once_a_turn_of_the_motors() -> None:
    """Reductions 262, 524, 524, 524 and 384, and 6 counts a turn, of which the roll has 3."""
    marks = index_marks(CELL)
    assert [round(math.tau / mark.period_rad) for mark in marks] == [262, 524, 524, 524, 384] * 2
    assert [mark.counts for mark in marks] == [6, 6, 6, 6, 3] * 2


@pytest.mark.parametrize("cell", [CELL, cell_of_encoders()])
def test_a_count_at_a_pulse_gives_the_zero_wherever_the_joint_was_parked(cell: object) -> None:
    """The shaft is turned by hand: counts are edges passed since power-on, a pulse comes at each whole turn."""
    draw = np.random.default_rng(5)
    for mark in index_marks(cell):  # type: ignore[arg-type]
        for _ in range(200):
            parked = mark.home_rad + draw.uniform(-0.999, 0.999) * mark.unique_within_rad
            first_edge = math.floor(parked / mark.scale.step)
            pulse = round(parked / mark.period_rad) + int(draw.integers(-1, 2))
            latched = pulse * mark.counts * int(math.copysign(1, mark.scale.step)) - first_edge
            zero = mark.zero(latched)
            angle = mark.home_rad + draw.uniform(-1.0, 1.0)
            code = math.floor(angle / mark.scale.step) - first_edge
            assert abs((code - zero) * mark.scale.step - angle) <= 0.5001 * mark.scale.lsb


def test_without_doubt_about_the_pulse_the_nominal_zero_is_kept() -> None:
    for mark in index_marks(CELL):
        edge_at_home = round(-(mark.scale.zero + 0.5))
        for pulse in (-1, 0, 1):
            nearest = round(edge_at_home / mark.counts) + pulse
            assert mark.zero(nearest * mark.counts - edge_at_home) == mark.scale.zero


def test_a_joint_that_may_stand_at_either_of_two_pulses_cannot_be_homed() -> None:
    (first, *rest) = homing_problems(homed(CELL, 0.3))
    assert first == (
        "control.homing.parked_within_deg = 0.3: the index of joint 'master_shoulder' comes every 6 counts, 0.687 "
        "degrees; must be below half of that less half a count, 0.2863, or nobody knows which pulse it was"
    )
    assert len(rest) == 5
    assert not list(problems(CELL))


def test_a_cell_without_encoders_has_nothing_to_home_by() -> None:
    (line,) = problems(homed(load_cell("konkuk1")))
    assert line.startswith("control.homing: no joint has an encoder")
    with pytest.raises(CellError, match=r"control.homing.speed_deg_s = -1"):
        load_cell("rhino-pair", {"control.homing.speed_deg_s": "-1"})
