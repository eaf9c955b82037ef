"""What the command line accepts for being on time."""

import pytest

from canarm.options import WallClockOptions
from canarm.usage import UsageError
from canarm_protocol.cell.cell_file import load_cell


@pytest.mark.parametrize(
    ("options", "clock"),
    [
        (WallClockOptions(), "sync"),
        (WallClockOptions(), "wall"),
        (WallClockOptions(realtime=True, spin=2499), "wall"),
    ],
)
def test_what_can_be_is_accepted(options: WallClockOptions, clock: str) -> None:
    options.check(clock, load_cell("konkuk1"))


@pytest.mark.parametrize(
    ("options", "given"), [(WallClockOptions(realtime=True), "--realtime"), (WallClockOptions(spin=50), "--spin 50")]
)
def test_lockstep_has_no_use_for_them(options: WallClockOptions, given: str) -> None:
    with pytest.raises(UsageError, match=f"^{given}: lockstep waits for no clock; leave it out, or take --clock wall$"):
        options.check("sync", load_cell("konkuk1"))


def test_a_spin_of_a_whole_cycle_would_never_sleep() -> None:
    with pytest.raises(UsageError, match=r"^--spin 2500: must be less than the cycle of 2500 us$"):
        WallClockOptions(spin=2500).check("wall", load_cell("konkuk1"))
