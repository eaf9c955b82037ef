"""The true brakes of a robot: one file a kind, and `registry.py` lists them."""

from .base import BrakeModel
from .registry import make_brake

__all__ = ["BrakeModel", "make_brake"]
