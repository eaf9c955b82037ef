"""Which cycle of a run the robot's bus is in: by counting SYNC from NMT start on, or by its counter and telemetry."""

from canarm_protocol.cell.configuration import SYNC_COUNTER


class CycleCount:
    """`cycle` is that of the last SYNC, -1 between NMT start and the first; None until it is known."""

    def __init__(self) -> None:
        self.cycle: int | None = None
        self._near: int | None = None

    def forget(self) -> None:
        """What comes from now on begins anew."""
        self.cycle = self._near = None

    def anchor(self, cycle: int | None) -> None:
        """Telemetry says that the present cycle is about this one: the next SYNC's counter tells exactly which."""
        self._near = cycle

    def start(self) -> None:
        """NMT start: the next SYNC is cycle 0."""
        self.cycle = -1

    def sync(self, data: bytes) -> None:
        """A SYNC, with its counter or without."""
        counter = data[0] if len(data) == 1 else None
        if self.cycle is not None:
            self.cycle += 1
            if counter is None or self.cycle % SYNC_COUNTER + 1 == counter:
                return
            self.cycle = None  # a SYNC was missed, or another master counts
        if self._near is not None and counter is not None:
            ahead = (counter - 1 - self._near) % SYNC_COUNTER
            self.cycle = self._near + (ahead if ahead <= SYNC_COUNTER // 2 else ahead - SYNC_COUNTER)
            if self.cycle < 0:
                self.cycle = None
