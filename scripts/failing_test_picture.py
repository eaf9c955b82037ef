"""Draw the plot of the README's failing fault test: docs/pictures/failing-test.svg, the same bytes every time."""

from pathlib import Path

from canarm import Rig
from canarm.reports.run_plot import plot_run

PICTURE = Path(__file__).parent.parent / "docs" / "pictures" / "failing-test.svg"
TITLE = "test_motor_lead.py::test_the_forearm_does_not_fall"


def draw() -> str:
    """The run of the README's test, as the pytest plugin plots it."""
    with Rig("konkuk1", law="mras", seed=0) as rig:
        rig.inject("joint3.motor", "open-load", at=3.0)
        rig.run(seconds=4.0)
    return plot_run(TITLE, {"joint3": rig.joints["joint3"]}, rig.begun, rig.noticed)


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
    print(PICTURE)
