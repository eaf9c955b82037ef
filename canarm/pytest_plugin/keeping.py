"""What stays of the runs of a test: nothing where it passes; run folder and plot, with names, where it fails."""

import contextlib
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

PLOT_FILE = "joints.svg"
LONGEST_NAME = 80


class Run(Protocol):
    """A run that may be kept."""

    @property
    def folder(self) -> Path | None:
        """Its run folder, if it has begun one."""
        ...

    def end(self) -> None:
        """End it and write all of it out. May be called again."""
        ...

    def plot(self, title: str) -> str:
        """Its joints as SVG text."""
        ...

    def story(self) -> str:
        """What happened, a line each."""
        ...


class Keeper:
    """The runs of the test called `name`: below `temporary` while it runs, kept there or in `out` if it fails."""

    def __init__(self, name: str, temporary: Path, out: Path | None) -> None:
        self._name, self._temporary, self._out = name, temporary, out
        self._runs: list[Run] = []
        self._count = 0
        self._kept: list[str] | None = None

    def new_folder(self) -> Path:
        """A name for the folder of another run; nothing is there yet."""
        self._count += 1
        return self._temporary / f"run-{self._count}"

    def watch(self, run: Run) -> None:
        """Keep this one as well, if it comes to that."""
        self._runs.append(run)

    def keep(self) -> list[str]:
        """End and keep every run; what became of each, for the report. Raises nothing: the test's error matters."""
        if self._kept is None:
            self._kept = []
            for number, run in enumerate(self._runs, start=1):
                try:
                    self._kept.append(self._keep_run(run, number))
                except Exception as error:
                    self._kept.append(f"the run could not be kept: {type(error).__name__}: {error}")
        return self._kept

    def clear(self) -> None:
        """After the test: remove what is not kept."""
        if self._kept is None or self._out is not None:
            shutil.rmtree(self._temporary, ignore_errors=True)

    def _keep_run(self, run: Run, number: int) -> str:
        run.end()
        folder = run.folder
        if folder is None or not folder.exists():
            return "no run was begun"
        if self._out is not None and folder.is_relative_to(self._temporary):
            folder = self._move(folder)
        title = f"{self._name}, run {number}" if len(self._runs) > 1 else self._name
        (folder / PLOT_FILE).write_text(run.plot(title), encoding="utf-8")
        return f"run folder: {folder}\nplot: {folder / PLOT_FILE}\n{run.story()}"

    def _move(self, folder: Path) -> Path:
        """A copy in the folder that the user named, which may hold runs of earlier tests."""
        assert self._out is not None
        name = re.sub(r"[^\w.=-]+", "-", self._name).strip("-")[:LONGEST_NAME]
        self._out.mkdir(parents=True, exist_ok=True)
        for free in _names(self._out / name):
            with contextlib.suppress(FileExistsError):
                return Path(shutil.copytree(folder, free))
        raise AssertionError("names do not end")


def _names(path: Path) -> Iterator[Path]:
    yield path
    number = 2
    while True:
        yield path.with_name(f"{path.name}-{number}")
        number += 1
