"""The split of a cycle: the parts are given what they got in a run, and add up to the whole."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import cycle
import machine
import replay
from measure import yardstick_s

from canarm import Rig
from canarm_protocol.cell import load_cell


@pytest.fixture(scope="module")
def recorded() -> replay.Recorded:
    return replay.record("konkuk1", 20)


def test_the_run_that_is_kept_is_the_run_of_a_rig(recorded: replay.Recorded) -> None:
    with Rig("konkuk1", law=replay.LAW, seed=0) as rig:
        rig.run(20 * 0.0025)
        angles = rig.joints["joint2"].true_angle_rad
    assert len(recorded.cycles) == 20
    assert [turn.joints[0].angle_rad for turn in recorded.cycles][:19] == list(angles)[1:]


def test_every_cycle_has_its_frames_both_ways(recorded: replay.Recorded) -> None:
    """Two RPDOs for current and direction and a SYNC; three TPDOs of eight-bit codes and a TIME."""
    assert {frame.can_id for frame in recorded.cycles[5].sent} == {0x312, 0x213, 0x080}
    assert {frame.can_id for frame, _ in recorded.cycles[5].answers} == {0x294, 0x394, 0x100}


def test_the_parts_add_up_to_the_whole(recorded: replay.Recorded) -> None:
    split = cycle.parts(recorded)
    whole = split.pop("cycle (rig)")
    assert set(split) == {
        "physics", "electrics", "cards and slaves", "bus", "controller", "supervision", "bookkeeping"
    }  # fmt: skip
    assert sum(split.values()) == pytest.approx(whole)
    assert min(split["physics"], split["controller"]) > 0.0


def test_rows_are_shares_of_the_whole_and_ratios_to_the_yardstick() -> None:
    rows = cycle.table({"cycle (rig)": [2e-4, 2e-4], "physics": [5e-5, 5e-5]}, [1e-4, 2e-4])
    assert [row.ratio.median for row in rows] == pytest.approx([1.5, 0.375])
    assert (rows[1].ratio.low, rows[1].ratio.high) == pytest.approx((0.25, 0.5))
    assert rows[1].remark == "50.0 us a cycle, 25 %"


def test_a_cycle_of_konkuk1_takes_four_steps() -> None:
    """Six channels of 100 us in one step of at most 650 us, then 1900 us in three."""
    cell = load_cell("konkuk1")
    assert (cell.bus.cycle_us, cell.physics.max_step_us) == (2500, 650)
    assert replay.steps_per_cycle(cell) == 4


def test_the_yardstick_takes_time() -> None:
    assert yardstick_s() > 0.0


@pytest.mark.parametrize(
    ("configured", "said"),
    [
        ("'--enable-optimizations' '--with-lto=thin' '--enable-shared'", "profile-guided and link-time"),
        ("'--prefix=/usr/local' '--enable-shared'", "not optimised by profile"),
        (None, "optimisation not known"),  # Windows
    ],
)
def test_a_benchmark_says_how_its_python_was_built(configured: str | None, said: str) -> None:
    assert machine.optimisation(configured) == said


def test_a_benchmark_says_whether_canarm_is_compiled() -> None:
    known = machine.python()
    assert known["canarm"] in {"plain Python", "compiled"} or known["canarm"].startswith("compiled in part")
    assert machine.python_text(known).endswith(f"canarm: {known['canarm']}")
