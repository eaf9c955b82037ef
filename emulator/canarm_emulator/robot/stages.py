"""Stages of drives and sensors at which faults can act, as their kinds declare them; the faults make taps of them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Stage:
    """A place at which faults can act: the end of its tap's name, what flows there, and its range."""

    name: str
    about: str
    unit: str
    high: float
