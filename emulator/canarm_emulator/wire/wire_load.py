"""How busy a bus was, since start and over a window, computed from intervals of time."""

from collections import deque


class BusLoad:
    """Adds up disjoint intervals in order of time; a window reaches back `history_ns` at most."""

    def __init__(self, start_ns: int, history_ns: int) -> None:
        self._start_ns, self._history_ns = start_ns, history_ns
        self._busy_ns = 0
        self._intervals: deque[tuple[int, int]] = deque()
        self._recent_ns = 0
        """Busy time of the intervals in memory."""
        self._peak_ns = 0

    def add(self, begun_ns: int, ended_ns: int) -> None:
        """The bus was busy; `ended_ns` may lie ahead."""
        length_ns, intervals = ended_ns - begun_ns, self._intervals
        self._busy_ns += length_ns
        intervals.append((begun_ns, ended_ns))
        recent_ns, reach_ns = self._recent_ns + length_ns, begun_ns - self._history_ns
        while intervals[0][1] < reach_ns:
            oldest_begun_ns, oldest_ended_ns = intervals.popleft()
            recent_ns -= oldest_ended_ns - oldest_begun_ns
        self._recent_ns = recent_ns
        if recent_ns <= self._peak_ns:
            return
        # The busiest window ends with an interval.
        busy_ns, from_ns = recent_ns, ended_ns - self._history_ns
        for oldest_begun_ns, oldest_ended_ns in intervals:
            if oldest_begun_ns >= from_ns:
                break
            busy_ns -= min(oldest_ended_ns, from_ns) - oldest_begun_ns
        if busy_ns > self._peak_ns:
            self._peak_ns = busy_ns

    def peak(self, now_ns: int) -> float:
        """Busy share of the busiest window of `history_ns`; of the time since start while that is less."""
        if now_ns - self._start_ns < self._history_ns:
            return self.share(now_ns, None, None)
        return self._peak_ns / self._history_ns

    def share(self, now_ns: int, window_ns: int | None, since_ns: int | None) -> float:
        """Busy share of time up to `now_ns`, 0 to 1, of the last `window_ns` or since start.

        `since_ns` is when an interval began that is not over and not added. Raises `ValueError` for too long a window.
        """
        if window_ns is not None and window_ns > self._history_ns:
            raise ValueError(f"window of {window_ns} ns; this wire remembers {self._history_ns} ns")
        from_ns = self._start_ns if window_ns is None else max(self._start_ns, now_ns - window_ns)
        if now_ns <= from_ns:
            return 0.0
        busy_ns = 0 if since_ns is None else now_ns - max(since_ns, from_ns)
        if window_ns is None:
            busy_ns += self._busy_ns
            if self._intervals:
                busy_ns -= max(0, self._intervals[-1][1] - now_ns)
        else:
            for begun_ns, ended_ns in reversed(self._intervals):
                if ended_ns <= from_ns:
                    break
                busy_ns += min(ended_ns, now_ns) - max(begun_ns, from_ns)
        return busy_ns / (now_ns - from_ns)
