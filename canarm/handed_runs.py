"""The runs of a demo, handed to dashboards in other processes: what is known of the present one, and how to run again.

Both sides talk in files of a folder that is theirs alone: the demo writes `runs.json`, a dashboard what it wants, and
the demo its answer. What a run is belongs to the demo, how it is shown to the dashboard.
"""

import contextlib
import json
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from canarm_protocol.errors import BusError, CanarmError, UsageError
from canarm_protocol.runs.own_file import replace_file

from .child import START_S

if TYPE_CHECKING:
    from canarm_tui.outcome import Outcome
    from canarm_tui.run_again import NextRun

    from .demo_runs import DemoRuns

OFTEN_S = 0.2
"""How often the demo looks whether a run has ended or another one is wanted."""
LIMIT_S = 3.0 * START_S
"""How long the end of one run and the beginning of another may take."""
STATE, WANTED, ANSWER = "runs.json", "wanted-", "answer-"
ANOTHER_BEGAN = "a run goes on, perhaps begun from another page; r runs again when it is over"


@contextlib.contextmanager
def handing_over(runs: "DemoRuns", folder: Path, tell: Callable[[str], None]) -> Iterator[None]:
    """Within, a thread writes what is known of the present run into `folder`, and begins another one when asked to.

    Each verdict is told. What the disk refuses is told, once.
    """
    hand = _Hand(runs, folder, tell)
    hand.write_state()
    is_over = threading.Event()

    def serve() -> None:
        while not is_over.wait(OFTEN_S):
            hand.look()

    thread = threading.Thread(target=serve, name="canarm-runs", daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


class _Hand:
    """The demo's side."""

    def __init__(self, runs: "DemoRuns", folder: Path, tell: Callable[[str], None]) -> None:
        self._runs, self._folder, self._tell = runs, folder, tell
        self._over = 0
        self._is_refused = False

    def look(self) -> None:
        """Whether something has changed, or is wanted."""
        runs = self._runs
        if runs.number != self._over and (found := runs.run.outcome()) is not None:
            self._over = runs.number
            self.write_state()
            self._tell(f"the run is over: {found[0]}; Ctrl-C ends the dashboard and gives the summary")
        for wanted in sorted(self._folder.glob(f"{WANTED}*")):
            self._answer(wanted)

    def write_state(self) -> None:
        """Write what is known of the present run."""
        runs = self._runs
        state = {
            "number": runs.number,
            "where": dict(runs.where),
            "folder": runs.folder,
            "last": asdict(runs.last),
            "hints": asdict(runs.hints),
            "outcome": runs.run.outcome(),
        }
        self._write(self._folder / STATE, state)

    def _answer(self, wanted: Path) -> None:
        from canarm_tui.run_again import NextRun

        try:
            words = NextRun(**json.loads(wanted.read_text(encoding="utf-8")))
            wanted.unlink()
            if not self._runs.run.is_over:
                raise UsageError(ANOTHER_BEGAN)
            answer = {"begun": self._runs.start(words)}
            self._tell(answer["begun"])
            self.write_state()
        except (CanarmError, OSError) as error:
            answer = {"refused": str(error)}
        self._write(wanted.with_name(wanted.name.replace(WANTED, ANSWER)), answer)

    def _write(self, path: Path, value: object) -> None:
        try:
            replace_file(path, json.dumps(value).encode())
        except OSError as error:
            if not self._is_refused:
                self._is_refused = True
                self._tell(f"{path}: {error.strerror}; the pages do not show how the run has ended")


class _Where(Mapping[str, Any]):
    """Host and port of the buses of the present run."""

    def __init__(self, state: Callable[[], Mapping[str, Any]]) -> None:
        self._state = state

    def __getitem__(self, key: str) -> Any:
        return self._state()["where"][key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._state()["where"])

    def __len__(self) -> int:
        return len(self._state()["where"])


class HandedRuns:
    """The dashboard's side: the runs of the demo that hands over in `folder`. Raises `UsageError` if none does."""

    ends_here = False
    """The demo goes on when one of its pages is left."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._names = folder, count(1)
        self._stamp: object = None
        self._read: Mapping[str, Any] = {}
        if not self._state():
            raise UsageError(f"{folder}: no demo hands over its runs here")
        self.where: Mapping[str, Any] = _Where(self._state)
        """Host and port of the buses, as options of a bus; it follows the present run."""

    @property
    def number(self) -> int:
        """Which run it is, from 1."""
        return int(self._state()["number"])

    @property
    def last(self) -> "NextRun":
        """The present run, as on the command line."""
        return self._words("last")

    @property
    def hints(self) -> "NextRun":
        """What a further run may be."""
        return self._words("hints")

    @property
    def folder(self) -> str:
        """Where the present run is recorded."""
        return str(self._state()["folder"])

    def outcome(self) -> "Outcome | None":
        """How the present run has ended, once it has."""
        from canarm_tui.outcome import Outcome

        found = self._state()["outcome"]
        return None if found is None else Outcome(*found)

    def start(self, wanted: "NextRun") -> str:
        """Ask for another run and wait for it. Raises `CanarmError` if there is none."""
        name = f"{os.getpid()}-{next(self._names)}.json"
        replace_file(self._folder / f"{WANTED}{name}", json.dumps(asdict(wanted)).encode())
        path, deadline_s = self._folder / f"{ANSWER}{name}", time.monotonic() + LIMIT_S
        while not path.exists():
            if time.monotonic() > deadline_s:
                raise BusError(f"the demo has not answered within {LIMIT_S:g} s")
            time.sleep(OFTEN_S / 4)
        answer = json.loads(path.read_text(encoding="utf-8"))
        path.unlink()
        if "refused" in answer:
            raise UsageError(answer["refused"])
        return str(answer["begun"])

    def _words(self, key: str) -> "NextRun":
        from canarm_tui.run_again import NextRun

        return NextRun(**self._state()[key])

    def _state(self) -> Mapping[str, Any]:
        """What the demo has written last; the file is read only when it is another one."""
        with contextlib.suppress(OSError, ValueError):
            path = self._folder / STATE
            found = path.stat()
            stamp = found.st_ino, found.st_mtime_ns
            if stamp != self._stamp:
                self._read, self._stamp = json.loads(path.read_text(encoding="utf-8")), stamp
        return self._read
