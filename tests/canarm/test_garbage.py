"""What a cycle leaves to the collector of cyclic garbage, which visits all containers that are kept again and again."""

import gc

import pytest

from canarm import Rig


def containers_per_cycle(cell: str, cycles: int) -> float:
    """How many more objects than before the collector knows of after `cycles`, for each of them."""
    with Rig(cell) as rig:
        rig.run(0.1)
        gc.collect()
        before = len(gc.get_objects())
        rig.run(cycles * rig.cell.bus.cycle_s)
        gc.collect()
        return (len(gc.get_objects()) - before) / cycles


@pytest.mark.parametrize(("cell", "cycles"), [("konkuk1", 1000), ("rhino-pair", 200)])
def test_histories_of_a_run_grow_by_plain_numbers_which_the_collector_need_not_visit(cell, cycles):
    # What is noted once in 10 ms may stay a while: a list for every robot, of 25 such times.
    assert containers_per_cycle(cell, cycles) < 1.0
