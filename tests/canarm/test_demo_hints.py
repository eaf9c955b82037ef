"""What the form to run again offers."""

import pytest

from canarm.demo_runs import DemoRuns
from canarm_protocol.cell import load_cell


@pytest.mark.parametrize(
    ("cell", "named"), [("konkuk1", "sine, trapezoid, excite"), ("rhino-pair", "circle, line, arc")]
)
def test_every_motion_of_the_cell_is_named_where_one_is_asked_for(cell, named):
    class Runs(DemoRuns):
        def __init__(self):
            self.run = type("Run", (), {"plan": type("Plan", (), {"cell": load_cell(cell), "clock": "sync"})})

    assert Runs().hints.trajectory.startswith(named)
