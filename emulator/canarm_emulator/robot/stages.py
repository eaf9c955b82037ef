"""Where in a drive or at a sensor faults can act: what a kind says of it. The taps themselves belong to the faults."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Stage:
    """A place at which faults can act: the end of its tap's name, what flows there, and its range."""

    name: str
    about: str
    unit: str
    high: float
