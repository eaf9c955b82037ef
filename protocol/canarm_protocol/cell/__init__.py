"""Cells: robots, cards and bus as values, and the files that describe them."""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from .arm import Body, Joint, Link, Motor, Robot
    from .cell_file import load_cell, parse_cell, shipped_cells
    from .export import export_dbc, export_dcf, export_eds
    from .model import Bus, Card, Cell, Channel, Control, Supervision

__all__ = [
    "Body",
    "Bus",
    "Card",
    "Cell",
    "Channel",
    "Control",
    "Joint",
    "Link",
    "Motor",
    "Robot",
    "Supervision",
    "export_dbc",
    "export_dcf",
    "export_eds",
    "load_cell",
    "parse_cell",
    "shipped_cells",
]

__getattr__ = loader(__name__, __all__, ".cell_file", ".model", ".arm", ".export")
