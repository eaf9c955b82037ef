"""What a bench knows of a run beforehand: whose clock, how long, how fast."""

from typing import NamedTuple


class RunPlan(NamedTuple):
    """As the bench and its controller say."""

    is_lockstep: bool
    ticks: int = 0
    """How long the controller's run is to last; 0 if nobody has said so."""
    pace: float | None = None
    """How many times as fast as the wall clock lockstep may be, infinity for as fast as it can; None if none is set."""
