"""The type of what a fault does to a number on its way."""

from collections.abc import Callable

Distortion = Callable[[float], float]
"""From the value that arrives at a point of the signal path to the one that goes on."""
