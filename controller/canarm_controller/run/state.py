"""The states of a run. The controller owns the transitions."""

from enum import IntEnum


class State(IntEnum):
    """States of a run, as published on the bench."""

    IDLE = 0
    BRINGING_UP = 1
    RUNNING = 2
    STOPPING = 3
    DONE = 4
    FAILED = 5

    def __str__(self) -> str:
        return self.name
