"""The true drives of a robot: one file a kind, and `registry.py` lists them."""

from .base import DriveModel, decay_over
from .registry import DRIVES, make_drive

__all__ = ["DRIVES", "DriveModel", "decay_over", "make_drive"]
