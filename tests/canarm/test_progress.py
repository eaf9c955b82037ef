"""What a campaign says of the time that is left: reckoned from runs, not from the start of the processes."""

import re
import time

import pytest

from canarm.workers.progress import Progress

STARTUP_S, RUN_S = 30.0, 2.0


@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_the_start_of_the_processes_is_no_part_of_the_time_that_is_left(
    jobs: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each process takes half a minute to start, and 2 s for a run: 80 runs take 160 s of process time."""
    total = 80
    ends_s = [STARTUP_S + RUN_S * (place // jobs + 1) for place in range(total)]
    clock_s = 0.0
    monkeypatch.setattr(time, "monotonic", lambda: clock_s)
    progress = Progress(jobs)
    progress(0, total)
    for done, clock_s in enumerate(ends_s, 1):  # noqa: B007
        progress(done, total)
    said = re.findall(r"\((\d+) of 80 runs\), (\d+) s left", capsys.readouterr().err)
    assert len(said) == 10
    for done, left_s in [(int(done), int(left_s)) for done, left_s in said][2:]:
        assert left_s == pytest.approx((total - done) * RUN_S / jobs, abs=RUN_S)


def test_of_a_first_run_the_time_is_reckoned_as_well_as_it_can_be(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    times_s = iter([0.0, 10.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(times_s))
    progress = Progress(jobs=4)
    progress(0, 5)
    progress(1, 5)
    assert "(1 of 5 runs), 40 s left" in capsys.readouterr().err
