"""Cells for arms that nobody has made a cell for: drives by arithmetic, cards and channels as many as it takes."""

from .request import NewCellError, Request, Sensing
from .writing import write_cell

__all__ = ["NewCellError", "Request", "Sensing", "write_cell"]
