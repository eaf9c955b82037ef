"""What is kept of a test's runs: nothing if it passes; named run folders and plots if it fails."""

import contextlib
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Protocol

from canarm_protocol.faults.fault_events import FaultEvent
from canarm_protocol.shown import named_error

PLOT_FILE = "joints.svg"
LONGEST_NAME = 80


class Run(Protocol):
    """A run that may be kept."""

    @property
    def folder(self) -> Path | None:
        """Its run folder, if there is one yet."""
        ...

    def end(self) -> None:
        """End it and write everything out. May be called again."""
        ...

    def plot(self, title: str) -> str:
        """Its joints as SVG text."""
        ...

    def story(self) -> str:
        """What happened, one line per event."""
        ...

    @property
    def label(self) -> str:
        """A label that tells it from other runs of the test."""
        ...

    def complaints(self) -> list[str]:
        """After its end: faults that never began or were themselves faulty, so that it tested too little."""
        ...


def fault_lines(events: Iterable[FaultEvent]) -> list[tuple[float, str]]:
    """Beginnings and ends of faults: time in s and text."""
    lines = []
    for each in events:
        failure = f": {each.failure}" if each.failure else ""
        lines.append((each.time_s, f"fault {'begins' if each.is_begin else 'ends'}: {each.label}{failure}"))
    return lines


def fault_complaints(never_begun: Iterable[str], events: Iterable[FaultEvent]) -> list[str]:
    """A run's complaints about its faults."""
    never = [f"fault never began: {name}" for name in never_begun]
    return never + [f"fault {each.tap} {each.fault} {each.failure}" for each in events if each.failure]


def file_name(name: str) -> str:
    """A folder name for a test."""
    return re.sub(r"[^\w.=-]+", "-", name).strip("-.")[:LONGEST_NAME] or "test"


class Keeper:
    """The runs of the test called `name`: below `temporary` while it runs, kept there or in `out` if it fails."""

    def __init__(self, name: str, temporary: Path, out: Path | None) -> None:
        self._name, self._temporary, self._out = name, temporary, out
        self._runs: list[Run] = []
        self._count = 0
        self._kept: list[tuple[str, str]] | None = None
        self._keeps_later = False

    def new_folder(self) -> Path:
        """The path for the folder of another run, which does not exist yet."""
        self._count += 1
        return self._temporary / f"run-{self._count}"

    def watch(self, run: Run) -> None:
        """Keep this run too, should the test fail."""
        self._runs.append(run)

    def complaints(self) -> list[str]:
        """Complaints of all runs, which have ended."""
        return [text for run in self._runs for text in run.complaints()]

    def keep(self) -> list[tuple[str, str]]:
        """End and keep every run; title and text of each for the report. Raises nothing."""
        if self._kept is None:
            self._kept = []
            for number, run in enumerate(self._runs, start=1):
                which = f", run {number} of {len(self._runs)}: {run.label}" if len(self._runs) > 1 else ""
                try:
                    text = self._keep_run(run, f"{self._name}{which}")
                except Exception as error:
                    text = f"the run could not be kept: {named_error(error)}"
                self._kept.append((f"canarm{which}", text))
        return self._kept

    def keep_later(self) -> list[tuple[str, str]]:
        """Keep every run once all tests that share it are over; returns title and text that say so."""
        self._keeps_later = True
        place = self._temporary if self._out is None else self._out
        return [("canarm", f"the run is shared by all tests of {self._name}; it will be kept below {place}")]

    def clear(self) -> None:
        """Remove what is not kept, after the test."""
        if self._keeps_later:
            self.keep()
        if self._kept is None or self._out is not None:
            shutil.rmtree(self._temporary, ignore_errors=True)

    def _keep_run(self, run: Run, title: str) -> str:
        run.end()
        folder = run.folder
        if folder is None or not folder.exists():
            return "no run was begun"
        if self._out is not None and folder.is_relative_to(self._temporary):
            folder = self._move(folder)
        (folder / PLOT_FILE).write_text(run.plot(title), encoding="utf-8")
        return f"run folder: {folder}\nplot: {folder / PLOT_FILE}\n{run.story()}"

    def _move(self, folder: Path) -> Path:
        """A copy in the folder that the user named, which may hold runs of earlier tests."""
        assert self._out is not None
        self._out.mkdir(parents=True, exist_ok=True)
        for free in _names(self._out / file_name(self._name)):
            with contextlib.suppress(FileExistsError):
                return Path(shutil.copytree(folder, free))
        raise AssertionError("names do not end")


def _names(path: Path) -> Iterator[Path]:
    yield path
    number = 2
    while True:
        yield path.with_name(f"{path.name}-{number}")
        number += 1
