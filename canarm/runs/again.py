"""What to type to have a recorded run again: a command line from what its folder says, and what no line can repeat.

Nothing that a folder names is opened. A line is text to be read before it is run, safe to show.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

from canarm_controller.laws.loading import LAWS
from canarm_controller.reference.trajectory import named_motions
from canarm_emulator.serving.recording import SCRIPT
from canarm_protocol.cell.cell_file import shipped_cells
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.settings import setting_keys
from canarm_protocol.errors import CanarmError
from canarm_protocol.faults.fault_toml import as_toml
from canarm_protocol.faults.script import FaultScript, parse_faults
from canarm_protocol.runs.run_folder import RunFolderError
from canarm_protocol.shown import printable, quoted

from ..open_cell import open_cell
from ..rig.arguments import checked_seed
from ..run_lines import demo_line, emulator_line
from ..usage import UsageError, value_text
from .run import SCRIPT_TEXT, Run

AFTERWARDS_S = 5.0
"""A run of unknown length that has stopped itself gets so much more: it has to stop by itself again."""
LONGEST_S = 1e6
LONGEST_LINE = 2000
NAMELESS_CELL, NAMELESS_FAULTS, NAMELESS_MOTION = "CELL.toml", "faults.toml", "MOTION.csv"
_BY_HAND = {"truth": "the truth was changed", "emergency-stop": "the emergency stop", "power-cycle": "the power cycle"}


@dataclass(frozen=True)
class Again:
    """A command line, and remarks: what has to be done before, or is not repeated by it."""

    line: str
    remarks: tuple[str, ...]


def demo_again(run: Run) -> Again | None:
    """The `canarm demo` that makes the run again; of a run with another master the `canarm emulator` of it.

    None where the folder does not say enough.
    """
    made = run.made_by
    law = made.get("law")
    if not isinstance(law, str):
        return emulator_again(run)
    seconds = _seconds(run)
    if seconds is None:
        return None
    common, remarks = _common(run)
    if law not in LAWS:
        remarks.append(f"its law is code, {printable(law)}: read it before you run it")
    motion = _text(run.summary.get("trajectory")) or _text(made.get("trajectory"))
    if motion is not None and _is_of_python(run, motion):
        remarks.append(f"its motion was given in Python, {printable(motion)}: --trajectory has to name a file of it")
        motion = NAMELESS_MOTION
    line = demo_line(
        seconds=seconds,
        law=law,
        trajectory=motion,
        feedforward=_text(run.summary.get("feedforward")) or _text(made.get("feedforward")),
        **common,
    )
    return Again(printable(line, LONGEST_LINE), tuple(remarks))


def emulator_again(run: Run) -> Again | None:
    """The `canarm emulator` that makes the robot of the run again; None where the folder does not say enough."""
    if not run.made_by:
        return None
    common, remarks = _common(run)
    return Again(printable(emulator_line(**common), LONGEST_LINE), tuple(remarks))


def fault_file_of(run: Run) -> str:
    """The faults that were declared before cycle 0, as the text of one fault file.

    Raises `UsageError` where there are none, or no file can say them, `RunFolderError` where nothing tells of any, and
    `FaultError` for what is no script.
    """
    texts = [text for each in _scripts(run, before=True) if (text := _text(each.get(SCRIPT_TEXT)))]
    if not texts and (why := untold_faults(run)):
        raise RunFolderError(f"{run.path}: {why}")
    if not texts:
        raise UsageError(f"{run.path}: no faults were declared before it began")
    scripts = [parse_faults(text) for text in texts]
    if len(scripts) == 1:
        return as_toml(scripts[0])
    if not all(script.is_parallel or len(script.sets) == 1 for script in scripts):
        raise UsageError(f"{run.path}: {len(scripts)} scripts that wait for one another; no one file says them")
    return as_toml(FaultScript(tuple(each for script in scripts for each in script.sets), is_parallel=True))


def untold_faults(run: Run) -> str:
    """Why nobody can tell which faults, or which others, were declared; empty if the events are whole. Safe to show."""
    found = bool(_scripts(run, before=True))
    if not run.damaged_events:
        return ""
    which = "which others" if found else "which faults"
    why = f"{which} were declared cannot be told: {printable('; '.join(run.damaged_events))}"
    named = _given(run, "--faults")
    return why if found or not named else f"{why}; its command line has --faults {printable(named[0])}"


def _common(run: Run) -> tuple[dict[str, Any], list[str]]:
    """The options that emulator and demo share, and remarks."""
    made, remarks = run.made_by, []
    cell, settings = _cell(run)
    if cell == NAMELESS_CELL:
        remarks.append(f"its cell is none that canarm brings along: {NAMELESS_CELL} has to be that of run.json")
    truth, seed = made.get("truth"), made.get("seed")
    faults = _given(run, "--faults")[:1] or _nameless_faults(run, remarks)
    remarks += _by_hand(run)
    try:
        seed = checked_seed(0 if seed is None else seed)
    except UsageError:
        remarks.append(f"its seed is none that canarm takes: {quoted(seed)}; the line has 0")
        seed = 0
    if why := untold_faults(run):
        remarks.append(why)
    common = {
        "cell": cell,
        "settings": settings,
        "seed": seed,
        "wire": made.get("wire") is True,
        "truth": [(str(key), str(value)) for key, value in truth.items()] if isinstance(truth, Mapping) else [],
        "faults": faults[0] if faults else None,
        "clock": "wall" if made.get("clock") == "wall" else "sync",
    }
    return common, remarks


def _nameless_faults(run: Run, remarks: list[str]) -> list[str]:
    if not _scripts(run, before=True):
        return []
    path = printable(str(run.path))
    remarks.append(f"its faults first: canarm runs show {path} --faults > {NAMELESS_FAULTS}")
    return [NAMELESS_FAULTS]


def _by_hand(run: Run) -> Iterator[str]:
    """What came on the way, which no command line has."""
    found = [f"{len(late)} fault scripts"] if (late := _scripts(run, before=False)) else []
    found += [text for name, text in _BY_HAND.items() if any(each["event"] == name for each in run.event_list)]
    if found:
        yield f"not in it, for it came on the way: {', '.join(found)}"


def _scripts(run: Run, before: bool) -> list[dict[str, Any]]:
    """The fault scripts that came before cycle 0, or the later ones."""
    return [each for each in run.event_list if each["event"] == SCRIPT and (each["cycle"] < 0) is before]


def _is_of_python(run: Run, motion: str) -> bool:
    """Whether a rig was given a function, an array or a table: neither a named motion nor a file."""
    try:
        known = named_motions(run.cell)
    except CanarmError:
        return False
    return "rig" in run.configuration and motion.partition(":")[0] not in known and not PurePath(motion).suffix


def _cell(run: Run) -> tuple[str, list[tuple[str, str]]]:
    """The name or file of the cell, and the settings with which that is the recorded one."""
    given = _given(run, "--cell")
    pairs = [(key, value) for key, equals, value in (each.partition("=") for each in _given(run, "--set")) if equals]
    try:
        recorded = run.cell
    except CanarmError:
        return (given[-1] if given else NAMELESS_CELL), pairs
    name = recorded.name
    if name in shipped_cells():
        for settings in (pairs, *_differences(recorded)):
            if _is_same(name, settings, recorded):
                return name, settings
    own = [each for each in given if each not in shipped_cells()]
    return (own[-1], pairs) if own else (NAMELESS_CELL, [])


def _differences(recorded: Cell) -> Iterator[list[tuple[str, str]]]:
    """Settings that may make the shipped cell the recorded one: of all joints together, then with those of each."""
    settings: list[tuple[str, str]] = []
    for of_joints in (False, True):
        try:
            usual = setting_keys(open_cell(recorded.name, dict(settings)))
        except CanarmError:
            return
        settings += [
            (key, value_text(value))
            for key, value in setting_keys(recorded).items()
            if usual.get(key) != value and (key.split(".")[1] in recorded.joint_names) is of_joints
        ]
        yield settings


def _is_same(name: str, settings: Sequence[tuple[str, str]], recorded: Cell) -> bool:
    try:
        return open_cell(name, dict(settings)).model_dump(mode="json") == recorded.model_dump(mode="json")
    except CanarmError:
        return False


def _given(run: Run, option: str) -> list[str]:
    """What the programs of the run were given after `option` on their command lines."""
    for section in ("emulator", "controller"):
        made = run.configuration.get(section)
        words = made.get("command_line") if isinstance(made, Mapping) else None
        texts = [str(each) for each in words] if isinstance(words, list) else []
        after = [word for before, word in itertools.pairwise(texts) if before == option]
        after += [word.partition("=")[2] for word in texts if word.startswith(f"{option}=")]
        if after:
            return after
    return []


def _seconds(run: Run) -> float | None:
    """The length that was asked for, or that the run had; None if neither is known."""
    given = run.made_by.get("seconds")
    if isinstance(given, int | float) and not isinstance(given, bool) and 0.0 < given <= LONGEST_S:
        return float(given)
    cycles, approach_s = run.summary.get("ticks"), run.summary.get("approach_s")
    try:
        period_s = run.cell.bus.cycle_s
    except CanarmError:
        return None
    if not isinstance(cycles, int) or not 0 < cycles * period_s <= LONGEST_S:
        return None
    left_s = approach_s if isinstance(approach_s, float) and math.isfinite(approach_s) else 0.0
    more_s = AFTERWARDS_S if run.summary.get("state") == "failed" else 0.0
    return max(cycles * period_s - max(left_s, 0.0) + more_s, period_s)


def _text(value: object) -> str | None:
    return value if isinstance(value, str) and value else None
