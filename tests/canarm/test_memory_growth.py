"""A rig that runs on and on keeps to the memory that it has."""

import gc
import sys

import pytest

from canarm import Rig
from canarm.rig.rig import FRAMES_KEPT

CYCLE_S = 0.0025
KEPT_BY_THE_ASSESSOR = 4096


def test_objects_do_not_grow_once_the_rings_are_full() -> None:
    """After 5000 cycles the ring of frames (10 000, about 6.5 a cycle) and the assessor's (4096 cycles) are full."""
    with Rig("konkuk1", law="mras", history_s=1.0) as rig:
        rig.run(5000 * CYCLE_S)
        counts = []
        for _ in range(3):
            gc.collect()
            counts.append(len(gc.get_objects()))
            rig.run(1000 * CYCLE_S)
        # One object per cycle would be a thousand more.
        assert max(counts) - min(counts) < 100


def test_histories_frames_and_events_are_bounded() -> None:
    with Rig("konkuk1", law="pd", history_s=1.0) as rig:
        rig.run(10.0)
        assert {len(joint.true_angle_rad) for joint in rig.joints.values()} == {400}
        assert len(rig.frames) == FRAMES_KEPT
        assert len(rig.events) == 2
        assert rig.frames[-1].time_ns == pytest.approx(10.0e9, abs=0.01e9)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.skipif(sys.platform == "win32", reason="the standard library tells no peak of memory there")
def test_a_million_cycles_take_no_more_memory_than_two_hundred_thousand() -> None:
    """No Python object is smaller than 16 bytes: one kept a cycle would be 13 MB in 800 000; the bound is 4 MB."""
    import resource

    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere

    def peak_bytes() -> int:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit

    with Rig("konkuk1", law="pd") as rig:
        rig.run(200_000 * CYCLE_S)
        before = peak_bytes()
        rig.run(800_000 * CYCLE_S)
        assert rig.controller.controlled_ticks == 1_000_000
        assert peak_bytes() - before < 4_000_000
