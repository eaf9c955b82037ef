"""Fault files for a run that is about to begin: read, and checked against its bench before anything starts."""

from dataclasses import replace
from pathlib import Path

from canarm_emulator.faults.engine import FaultEngine
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.script import FaultScript, read_faults
from canarm_protocol.shown import quoted


def load_faults(path: Path, bench: FaultBench) -> FaultScript:
    """The script in the file `path`, which `bench` supports; the bench stays as it is.

    Raises `FaultError`: file, set, fault, what would be right.
    """
    script = read_faults(path)
    if not any(declared.faults for declared in script.sets):
        raise FaultError(
            f"{path}: injects nothing; a fault file for a new run has at least one [[set]] with a [[set.fault]]"
        )
    engine = FaultEngine(bench, seed=0)
    for declared in script.sets:
        try:
            engine.accept(replace(script, sets=(declared,)))
        except FaultError as error:
            where = f"set {quoted(declared.name)}"
            text = str(error)
            raise FaultError(f"{path}: {text if text.startswith(where) else f'{where}: {text}'}") from None
    return script
