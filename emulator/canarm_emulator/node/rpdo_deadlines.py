"""Deadline monitoring of RPDOs (CiA 301, 7.5.2.35, sub-index 05h): from the first frame on, each is due in time.

What a missed deadline brings about is the node's business.
"""

from collections.abc import Mapping

from ..timing import NEVER


class RpdoDeadlines:
    """The RPDOs of one node that have an event timer, by their numbers."""

    def __init__(self) -> None:
        self.due_ns = NEVER
        """When the next deadline is missed."""
        self.is_used = False
        """Whether any RPDO is monitored."""
        self.missed: set[int] = set()
        """RPDOs that missed their deadline and have not come since."""
        self._timers_ns: dict[int, int] = {}
        self._due_ns: dict[int, int] = {}

    def activate(self, timers_ns: Mapping[int, int]) -> None:
        """Monitor RPDOs whose timer is not 0; each waits for its first frame."""
        self._timers_ns = {number: timer_ns for number, timer_ns in timers_ns.items() if timer_ns}
        self.is_used = bool(self._timers_ns)
        self._due_ns, self.due_ns = {}, NEVER

    def reset(self) -> None:
        """Nothing is monitored, nothing was missed."""
        self.activate({})
        self.missed.clear()

    def restart(self) -> None:
        """Each RPDO waits for its first frame again."""
        self._due_ns, self.due_ns = {}, NEVER

    def received(self, number: int, now_ns: int) -> bool:
        """An RPDO came; returns whether it is monitored."""
        timer_ns = self._timers_ns.get(number)
        if timer_ns is None:
            return False
        self.missed.discard(number)
        self._due_ns[number] = now_ns + timer_ns
        self.due_ns = min(self._due_ns.values())
        return True

    def run(self, now_ns: int) -> None:
        """Deadlines up to `now_ns` are missed: their RPDOs wait for a first frame again."""
        self.missed |= {number for number, due_ns in self._due_ns.items() if due_ns <= now_ns}
        self._due_ns = {number: due_ns for number, due_ns in self._due_ns.items() if due_ns > now_ns}
        self.due_ns = min(self._due_ns.values(), default=NEVER)
