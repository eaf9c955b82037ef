"""A run as text for a terminal. Foreign texts are made safe to show here."""

import math
from collections.abc import Iterator

from canarm_protocol.shown import printable, printable_values

from .again import demo_again
from .listing import size_text
from .run import Run, shown_details

MOST_EVENTS = 40
PARENT = "--with-parent"
"""What only canarm itself puts on a command line."""
LARGEST = 1e12
"""No figure of a run is larger; a hostile one may have more digits than can be shown."""
FIGURES = {
    "rms_lsb": "RMS error {:.3f} LSB",
    "max_lsb": "max {:.3f} LSB",
    "peak_current_a": "peak current {:.3f} A",
    "saturated_cycles": "{} cycles saturated",
}


def show_lines(run: Run) -> Iterator[str]:
    """What there is to say of a run, safe to print. Reads all of its files."""
    yield f"{printable(str(run.path))}: {run.headline}"
    for name, text in figure_texts(run):
        yield f"  {name}: {text}"
    again = demo_again(run)
    for key, value in run.made_by.items():
        is_internal = key == "command_line" and again is not None and PARENT in str(value)
        if isinstance(value, str | int | float | list) and key not in ("faults", "cell") and not is_internal:
            shown = " ".join(map(str, value)) if isinstance(value, list) else str(value)
            yield f"  {printable(key, 40)}: {printable(shown)}"
    yield from _files(run)
    events = run.event_list
    for event in events[:MOST_EVENTS]:
        when = f"{event['time_s']:10.4f} s" if math.isfinite(event["time_s"]) else " at first  "
        details, script = shown_details(event)
        yield f"{when}  {printable(event['event'], 40)}{': ' if details else ''}{details}"
        yield from (f"{'':14}{line}" for line in script)
    if len(events) > MOST_EVENTS:
        yield f"and {len(events) - MOST_EVENTS} events more"
    for text in run.complaints:
        yield f"not whole: {text}"
    yield from again_lines(run)


def again_lines(run: Run) -> Iterator[str]:
    """What to type to have the run again, with remarks, and to compare it with one."""
    again = demo_again(run)
    if again is not None:
        yield f"again: {again.line}"
        yield from (f"  {each}" for each in again.remarks)
    if run.made_by.get("law") and run.made_by.get("clock", "sync") == "sync":
        yield f"again, byte for byte (lockstep): canarm replay {printable(str(run.path))} --check"


def figure_texts(run: Run) -> Iterator[tuple[str, str]]:
    """Each joint of the summary, with its figures in words."""
    joints = printable_values(run.summary.get("joints"))
    for name, figures in joints.items() if isinstance(joints, dict) else ():
        if isinstance(figures, dict):
            known = [(key, figures.get(key)) for key in FIGURES]
            texts = [FIGURES[key].format(value) for key, value in known if _is_figure(value)]
            yield name, ", ".join(texts)


def _is_figure(value: object) -> bool:
    return isinstance(value, int | float) and abs(value) < LARGEST


def _files(run: Run) -> Iterator[str]:
    for table, columns in (("robot", run.robot), ("controller", run.controller)):
        if columns:
            yield f"  signals of the {table}: {len(columns['cycle'])} rows of {len(columns)} columns"
    for path in sorted(run.path.iterdir()):
        if path.is_file() and not path.is_symlink():
            yield f"  {printable(path.name, 60)}: {size_text(path.stat().st_size)}"
