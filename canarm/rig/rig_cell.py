"""A rig's cell, by name, file or value; traffic that does not fit gives one warning."""

import warnings
from collections.abc import Mapping
from pathlib import Path

from canarm_protocol.cell.model import Cell
from canarm_protocol.shown import quoted

from ..open_cell import open_cell
from ..session import traffic_warning
from ..usage import UsageError
from .arguments import RigWarning, as_text


def rig_cell(cell: str | Path | Cell, settings: Mapping[str, object] | None) -> Cell:
    """The cell; if it is named, with `settings` applied.

    Raises `CellError`, and `UsageError` for settings with a cell that is already loaded.
    """
    if isinstance(cell, Cell):
        if settings:
            raise UsageError("settings: go with the name or file of a cell; lay them over this one with load_cell()")
        loaded, name = cell, cell.name
    elif not isinstance(cell, str | Path):
        raise UsageError(f"cell {quoted(cell)}: must be a name, a file or a Cell")
    else:
        name = str(cell)
        loaded = open_cell(name, as_text("settings", settings), option="settings")
    warning = traffic_warning(loaded, name)
    if warning is not None:
        warnings.warn(warning, RigWarning, stacklevel=5)
    return loaded
