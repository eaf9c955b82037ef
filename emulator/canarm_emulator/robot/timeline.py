"""Virtual time of a bench: the present, the world that follows it, and the cycle of the present run."""

from .world import World


class Timeline:
    """Time in ns since the bench was switched on. Whoever acts at a time calls `reach` first."""

    __slots__ = ("begin_ns", "cycle", "run", "time_ns", "world")

    def __init__(self, world: World) -> None:
        self.world = world
        self.time_ns = 0
        self.cycle = -1
        """The last SYNC's number since NMT start; -1 before the first."""
        self.run = 0
        """How many runs NMT start has begun so far."""
        self.begin_ns: int | None = None
        """Time of cycle 0; None before."""

    def reach(self, time_ns: int) -> None:
        """Make `time_ns` the present, unless it is in the past."""
        if time_ns > self.time_ns:
            self.time_ns = time_ns

    def catch_up(self) -> None:
        """Move the world on to the present."""
        self.move_world(self.time_ns)

    def move_world(self, until_ns: int) -> None:
        """Move the world on to `until_ns`, if it is not there yet; it may run ahead of the present."""
        if until_ns > self.world.time_ns:
            self.world.advance(until_ns)
