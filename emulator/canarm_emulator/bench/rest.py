"""When an arm that nobody drives has come to rest."""

from collections.abc import Sequence

from ..robot.world import JointState

AT_REST_RAD_S, AT_REST_NS = 0.01, 300_000_000
"""An arm rests when every joint has been slower than this for this long: a swinging one is slow only for a moment."""
LONGEST_FALL_NS = 30_000_000_000
"""Bound on the wait: an arm without friction would swing for ever."""


class RestWatch:
    """Says how long to wait: until `end_ns` in any case, and then until the arms rest."""

    def __init__(self, now_ns: int, end_ns: int) -> None:
        self._moved_ns, self._end_ns = now_ns, end_ns

    def waits(self, now_ns: int) -> bool:
        """Whether time must go on."""
        if now_ns < self._end_ns:
            return True
        return now_ns < self._end_ns + LONGEST_FALL_NS and now_ns - self._moved_ns < AT_REST_NS

    def look(self, now_ns: int, joints: Sequence[JointState]) -> None:
        """Take the state of all joints."""
        if any(abs(joint.speed_rad_s) > AT_REST_RAD_S for joint in joints):
            self._moved_ns = now_ns
