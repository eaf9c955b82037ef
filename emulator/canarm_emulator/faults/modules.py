"""The modules that declare faults: our own in `kinds/`, and those of other packages, found by an entry point.

`declaration.py` imports this, so it must not know what a fault is.
"""

import functools
import importlib
import pkgutil
from importlib.metadata import entry_points

from canarm_protocol.errors import FaultError
from canarm_protocol.shown import quoted

ENTRY_POINTS = "canarm.faults"
"""Group of entry points; each names a module that declares faults."""
_KINDS = f"{__package__}.kinds"


def is_built_in(module: str) -> bool:
    """Whether a module is one of our own."""
    return module.startswith(f"{_KINDS}.")


@functools.cache
def load_built_in() -> None:
    """Import our own modules of faults."""
    for module in pkgutil.iter_modules(importlib.import_module(_KINDS).__path__):
        importlib.import_module(f"{_KINDS}.{module.name}")


@functools.cache
def import_declared() -> None:
    """Import our own modules of faults, then those of entry points. Raises `FaultError` where one cannot be."""
    load_built_in()
    for entry in entry_points(group=ENTRY_POINTS):
        try:
            entry.load()
        except (Exception, SystemExit) as error:
            where = f"faults of entry point {quoted(entry.name)} ({entry.value})"
            text = str(error) if isinstance(error, FaultError) else f"{type(error).__name__}: {error}"
            raise FaultError(f"{where}: {' '.join(text.split())}") from None
