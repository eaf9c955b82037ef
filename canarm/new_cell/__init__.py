"""Cells for new arms: drives sized by arithmetic, and as many cards and channels as needed."""

from .request import NewCellError, Request, Sensing
from .writing import write_cell

__all__ = ["NewCellError", "Request", "Sensing", "write_cell"]
