"""How a run has ended, handed to dashboards in other processes: a file that is not there before.

What an outcome says belongs to the run, how it is shown to the dashboard.
"""

import contextlib
import json
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from canarm_protocol.runs.own_file import replace_file

if TYPE_CHECKING:
    from canarm_tui.outcome import Outcome

OFTEN_S = 0.2
"""How often a run is asked whether it has ended."""
Said = tuple[str, bool, Sequence[str]]
"""The verdict in a few words, whether all went well, and details."""


@contextlib.contextmanager
def handing_over(outcome_of: Callable[[], Said | None], path: Path, tell: Callable[[str], None]) -> Iterator[None]:
    """Within: once `outcome_of` has one, it is written to `path`, and its verdict is told, in a thread."""
    is_over = threading.Event()

    def hand_over() -> None:
        while not is_over.wait(OFTEN_S):
            found = outcome_of()
            if found is not None:
                write_outcome(found, path, tell)
                tell(f"the run is over: {found[0]}; Ctrl-C ends the dashboard and gives the summary")
                return

    thread = threading.Thread(target=hand_over, name="canarm-outcome", daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


def write_outcome(outcome: Said, path: Path, tell: Callable[[str], None]) -> None:
    """Write the file in one go; what the disk refuses is told."""
    try:
        replace_file(path, json.dumps(outcome).encode())
    except OSError as error:
        tell(f"{path}: {error.strerror}; the pages do not show how the run has ended")


def outcome_in(path: Path | None) -> "Callable[[], Outcome | None]":
    """What returns the outcome in the file, once it is there; None before, and if there is no file to come."""
    from canarm_tui.outcome import Outcome

    def read() -> Outcome | None:
        if path is None:
            return None
        with contextlib.suppress(OSError, ValueError, TypeError):
            return Outcome(*json.loads(path.read_text(encoding="utf-8")))
        return None

    return read
