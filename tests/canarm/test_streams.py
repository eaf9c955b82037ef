"""Output that nobody reads ends no run, and a terminal that cannot show a sign gets another one."""

import shlex
import sys

import pytest

from canarm import streams

DEMO = f"{shlex.quote(sys.executable)} -m canarm demo --no-tui --seconds 0.5 --out run"


@pytest.mark.parametrize(
    "redirected",
    [
        "2>&1 | head -1",
        *(
            pytest.param(part, marks=pytest.mark.slow)
            for part in (">/dev/full 2>&1", "<&- >&- 2>&-", "2>/dev/full", "2>&-", ">&- 2>&-")
        ),
    ],
)
def test_a_run_goes_on_when_nobody_reads_what_it_says(canarm, run_folder, redirected):
    canarm.run("sh", "-c", f"{DEMO} {redirected}").wait()
    run = run_folder(canarm.folder / "run").check().run
    assert (run["summary"]["state"], run["summary"]["ticks"]) == ("done", 200)
    log = (canarm.folder / "run" / "can0.log").read_text()
    assert all(line.startswith("(") for line in log.splitlines())


def test_a_terminal_that_cannot_show_a_sign_gets_a_replacement(canarm):
    listed = canarm("check", "--keys", env={"PYTHONIOENCODING": "ascii:strict", "PYTHONUTF8": "0"})
    assert listed.wait() == 0, listed
    assert any("N?m?s/rad" in line for line in listed.stdout)


def test_a_stream_without_a_reader_takes_what_is_written_and_says_that_it_has_none(monkeypatch, capfd):
    class Gone:
        errors = "strict"

        def write(self, text: str) -> int:
            raise BrokenPipeError

        def fileno(self) -> int:
            raise OSError

    monkeypatch.setattr(sys, "stdout", Gone())
    monkeypatch.setattr(sys, "stderr", sys.stderr)
    streams.make_streams_safe()
    print("nobody reads this")
    assert sys.stdout.has_lost_its_reader
