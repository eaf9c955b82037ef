"""The cell that a rig is given, by name, file or value; whether its traffic fits is said once, as a warning."""

import warnings
from collections.abc import Mapping
from pathlib import Path

from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell

from ..session import traffic_warning
from ..usage import UsageError
from .arguments import RigWarning, as_text


def rig_cell(cell: str | Path | Cell, settings: Mapping[str, object] | None) -> Cell:
    """The cell, with `settings` laid over it where it is named.

    Raises `CellError`, and `UsageError` for settings beside a cell that is loaded already.
    """
    if isinstance(cell, Cell):
        if settings:
            raise UsageError("settings: go with the name or file of a cell; lay them over this one with load_cell()")
        loaded, name = cell, cell.name
    else:
        name = str(cell)
        loaded = load_cell(name, as_text(settings), option="settings")
    warning = traffic_warning(loaded, name)
    if warning is not None:
        warnings.warn(warning, RigWarning, stacklevel=4)
    return loaded
