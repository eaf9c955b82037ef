"""Draw the runs shown in the docs: docs/pictures/failing-test.svg and detected.svg, the same bytes every time."""

from pathlib import Path

from canarm import Rig
from canarm.rig.run_plot import plot_run

PICTURES = Path(__file__).parent.parent / "docs" / "pictures"
RUNS = {
    "failing-test.svg": ("test_motor_lead.py::test_the_forearm_does_not_fall", "joint3", "motor", "open-load"),
    "detected.svg": ("joint 2's tachometer is stuck from 3 s on", "joint2", "tachometer", "stuck"),
}
"""File → title, joint, tap and fault."""
FAULT_S, SECONDS = 3.0, 4.0


def draw(title: str, joint: str, tap: str, fault: str) -> str:
    """A run with a fault, as the pytest plugin plots it."""
    with Rig("konkuk1", law="mras", seed=0) as rig:
        rig.inject(f"{joint}.{tap}", fault, at=FAULT_S)
        rig.run(seconds=SECONDS)
    return plot_run(title, {joint: rig.joints[joint]}, rig.begun, rig.noticed)


if __name__ == "__main__":
    for name, run in RUNS.items():
        (PICTURES / name).write_text(draw(*run), encoding="utf-8")
        print(PICTURES / name)
