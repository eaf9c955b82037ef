"""Run folders below a folder: finding them, one line about each, and removing them.

Only what a run leaves is ever removed: a folder with anything else in it stays.
"""

import fnmatch
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from canarm_protocol.runs.own_file import is_held
from canarm_protocol.runs.parts import LONGEST_PART
from canarm_protocol.runs.run_events import runs_of
from canarm_protocol.runs.run_folder import RUN_FILE, SIGNALS_FOLDER, SUMMARY, RunFolderError, why_no_folder
from canarm_protocol.shown import printable

from .run import MAKERS, PARTS, Run

LEFT_BY_RUNS = (
    "run.json",
    ".run.json.lock",
    "events.jsonl",
    "memory.bin",
    "signals.mf4",
    "can0.mf4",
    "run.mcap",
    "report.html",
    "joints.svg",
    "controller-*.txt",
)
IN_PARTS = (
    "can0.log", "can0.blf", "bench.log", "bench.blf",
    "signals/robot.csv", "signals/robot.parquet", "signals/controller.csv", "signals/controller.parquet",
)  # fmt: skip
"""Files of a run folder, as patterns, and those that may have parts; of a recording that broke off, also drafts."""
_DRAFTS = (".draft-{}", ".{}.mf4", ".{}.[0-9]*")
_PART = re.compile(rf"-[0-9]{{4,{LONGEST_PART}}}(?=\.[a-z0-9]+$)")
DEEPEST = 3
"""Levels of folders below the base in which runs are looked for."""


@dataclass(frozen=True)
class Listed:
    """One run in a list: its folder, when it was last written, what it takes, and the run."""

    path: Path
    written: datetime
    size_bytes: int
    run: Run

    def as_plain(self) -> dict[str, Any]:
        """For `--json`."""
        said = self.run.summary
        known = {key: said.get(key) for key in ("cell", "law", "trajectory", "state", "ticks")}
        known["reason"] = self.run.reason
        return {"path": str(self.path), "written": self.written.isoformat(), "bytes": self.size_bytes, **known}


def runs_below(base: Path) -> list[Listed]:
    """The runs in `base` and below, oldest first. Raises `RunFolderError` if there is no such folder."""
    if not base.is_dir():
        raise RunFolderError(f"{base}: {why_no_folder(base)}; runs are recorded below runs/ unless --out says where")
    found = [_listed(path) for path in _folders(base, DEEPEST)]
    return sorted(found, key=lambda each: (each.written, str(each.path)))


def list_lines(runs: Sequence[Listed], base: Path) -> Iterator[str]:
    """A table for a terminal, safe to print."""
    names = [printable(str(each.path.relative_to(base)), 60) for each in runs]
    width = max((len(name) for name in names), default=0)
    for name, each in zip(names, runs, strict=True):
        written = each.written.strftime("%Y-%m-%d %H:%M")
        yield f"{name:<{width}}  {written}  {size_text(each.size_bytes):>9}  {each.run.headline}"


def size_text(size: int) -> str:
    """A number of bytes for people."""
    value, unit = float(size), "B"
    for unit in ("B", "kB", "MB", "GB"):
        if value < 1000 or unit == "GB":
            break
        value /= 1000
    return f"{value:.3g} {unit}"


def to_prune(runs: Sequence[Listed], keep: int | None, older_than: datetime | None) -> list[Listed]:
    """Of `runs`, oldest first, those beyond the newest `keep`, of these those written before `older_than`."""
    chosen = list(runs) if keep is None else list(runs[: max(len(runs) - keep, 0)])
    return [each for each in chosen if older_than is None or each.written < older_than]


def why_not_removed(run: Run) -> str:
    """Why a folder that looks like a run's is left alone: somebody writes to it, or no run of ours did; or nothing.

    Raises `OSError`.
    """
    if is_held(run.path):
        return "a run goes on in it"
    is_ours = any(run.configuration.get(name) for name in (SUMMARY, "cell", *MAKERS))
    if not is_ours and not run.robot and not run.controller:
        return f"neither {RUN_FILE} nor signals say that a run has left it"
    return ""


def remove_run(path: Path) -> list[str]:
    """Remove the files of a run and its folder; returns the names of what is not a run's and stays.

    A link is removed, not followed. Raises `OSError`.
    """
    for file in _tree(path):
        if (file.is_symlink() or not file.is_dir()) and _is_ours(file.relative_to(path).as_posix()):
            file.unlink()
    for folder in (path / SIGNALS_FOLDER, path):
        if folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir()):
            folder.rmdir()
    left = [each.relative_to(path).as_posix() for each in _tree(path)] if path.is_dir() else []
    return [name for name in left if name != SIGNALS_FOLDER and not fnmatch.fnmatchcase(name, "run-[0-9]*")]


def _listed(path: Path) -> Listed:
    files = [each for each in _tree(path) if each.is_file() and not each.is_symlink()]
    newest = path / RUN_FILE if (path / RUN_FILE).is_file() else path
    written = datetime.fromtimestamp(newest.stat().st_mtime, UTC)
    return Listed(path, written, sum(each.stat().st_size for each in files), Run(path))


def _folders(base: Path, depth: int) -> Iterator[Path]:
    if any((base / part).exists() for part in PARTS):
        yield from runs_of(base)
        return
    if depth:
        for each in sorted(base.iterdir()):
            if each.is_dir() and not each.is_symlink():
                yield from _folders(each, depth - 1)


def _tree(path: Path) -> Iterable[Path]:
    """What is in a run folder, without the later runs below it."""
    for each in sorted(path.iterdir()):
        yield each
        if each.name == SIGNALS_FOLDER and each.is_dir() and not each.is_symlink():
            yield from sorted(each.iterdir())


def _is_ours(name: str) -> bool:
    return _fits(name, (*LEFT_BY_RUNS, *IN_PARTS)) or _fits(_PART.sub("", name), IN_PARTS)


def _fits(name: str, patterns: Iterable[str]) -> bool:
    folder, _, file = name.rpartition("/")
    for pattern in patterns:
        of, _, wanted = pattern.rpartition("/")
        if of == folder and any(fnmatch.fnmatchcase(file, each.format(wanted)) for each in ("{}", *_DRAFTS)):
            return True
    return False
