"""The true sensors of a robot: one file a kind, and `registry.py` lists them."""

from .base import DistortedSource, Moment, SensorKind, Source
from .noise import normal_deviates
from .registry import SENSORS, source

__all__ = ["SENSORS", "DistortedSource", "Moment", "SensorKind", "Source", "normal_deviates", "source"]
