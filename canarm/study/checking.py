"""Whether a study can run at all: every cell, law, motion, key and fault file of it, before the first run.

Each is tried once by itself, and with the others as the first run that has it; not every combination.
"""

from collections.abc import Iterator
from pathlib import Path

from canarm_emulator.robot.truth import Truth
from canarm_protocol.cell.bench_objects import SETTLING_CYCLES
from canarm_protocol.clock import Clock
from canarm_protocol.errors import CanarmError
from canarm_protocol.shown import printable

from ..draws import Choice, Value, Whole
from ..fault_file import load_faults
from ..open_cell import open_cell
from ..session import make_bench, make_controller, tick_count
from ..summary import errors_count_later
from ..usage import UsageError
from .plan import Axis, Settings, Study

MOST_VALUES = 200
"""More values of one axis are not tried one by one."""


def check_study(study: Study, source: str) -> None:
    """Raise `UsageError` for the first setting that no run can have; `source` is the file."""
    for axis, value, settings in _tried(study):
        if error := _wrong(settings):
            axis, value = (axis, value) if axis else _culprit(study, str(error))
            where = "run" if axis is None else f"vary.{axis.name}, {value}"
            lines = str(error).splitlines() or [type(error).__name__]
            raise UsageError("\n".join(f"{source}: {where}: {line}" for line in lines))


def _culprit(study: Study, said: str) -> tuple[Axis | None, Value | None]:
    """The axis whose value alone makes the first run impossible, if it is one."""
    for axis in study.axes if not _wrong(study.base) else ():
        value = study[0][axis.name]
        if str(_wrong(study.base.changed({axis.name: value}))) == said:
            return axis, value
    return None, None


def without_errors(study: Study) -> str | None:
    """What to say where runs end before their errors count, so that they have no figure of them; None if none does."""
    axis = next((axis for axis in study.axes if axis.name == "cell" and isinstance(axis, Choice)), None)
    names = (study.base.cell,) if axis is None else tuple(map(str, axis.values))
    short = []
    for name in names:
        cell = open_cell(name, dict(study.base.settings) if axis is None else {})
        if tick_count(cell, study.base.seconds, "seconds") <= SETTLING_CYCLES:
            short.append(f"{SETTLING_CYCLES * cell.bus.cycle_s:g} s of {printable(name, 60)}")
    if not short:
        return None
    return (
        f"runs of {study.base.seconds:g} s have no figure of their errors: {errors_count_later('seconds in [run]')}, "
        f"that is more than {', '.join(short)}"
    )


def named_files(study: Study) -> set[Path]:
    """The files that a study names: cells, laws, motions and faults."""
    found = set()
    for _, _, settings in _tried(study):
        law = settings.law.partition(":")[0] if ":" in settings.law else None
        motion = settings.trajectory and settings.trajectory.partition(":")[0]
        found |= {Path(each) for each in (settings.cell, law, motion, settings.faults) if each}
    return found


def _tried(study: Study) -> Iterator[tuple[Axis | None, Value | None, Settings]]:
    """What is tried: the first run, then every end or value of each axis, with the rest as in the first run."""
    first = study[0]
    yield None, None, study.base.changed(first)
    for axis in study.axes:
        for value in _ends(axis):
            yield axis, value, study.base.changed(first | {axis.name: value})


def _ends(axis: Axis) -> tuple[Value, ...]:
    if isinstance(axis, Choice):
        return axis.values[:MOST_VALUES]
    if isinstance(axis, Whole):
        return (axis.low,)
    return axis.low, axis.high


def _wrong(settings: Settings) -> Exception | None:
    try:
        _check(settings)
    except (CanarmError, OSError) as error:
        return error
    return None


def _check(settings: Settings) -> None:
    from canarm_controller.reference.trajectory import usual_motion

    cell = open_cell(settings.cell, dict(settings.settings), option="set")
    truth = dict(settings.truth)
    tick_count(cell, settings.seconds, "seconds")
    motion = usual_motion(cell) if settings.trajectory is None else settings.trajectory
    make_controller(cell, settings.law, motion, settings.feedforward, Clock.SYNC)
    Truth.from_settings(cell, truth, "truth")
    if settings.faults is not None:
        load_faults(Path(settings.faults), make_bench(cell, truth, Clock.SYNC, settings.seed, settings.wire, "truth"))
