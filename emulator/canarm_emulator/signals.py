"""The type of a fault's effect on a signal."""

from collections.abc import Callable

Distortion = Callable[[float], float]
"""Takes the value that arrives at a point of the signal path, and returns the value that goes on."""
