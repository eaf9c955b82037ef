"""What drives virtual time; both sides of a bus must agree on it."""

from enum import Enum


class Clock(Enum):
    """The wall clock, or SYNC (lockstep: time stands still until one arrives). The value is that of object 0x2000."""

    WALL = 0
    SYNC = 1
