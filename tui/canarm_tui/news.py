"""Whether a screen is to be drawn: at once for news, and without any from time to time, for ages and counters."""


class News:
    """Asked at every tick of a timer. Without news it is time every `idle_ns`."""

    def __init__(self, idle_ns: int) -> None:
        self._idle_ns = idle_ns
        self._drawn: object = None
        self._due_ns = 0

    def is_due(self, news: object, now_ns: int) -> bool:
        """Whether to draw; `news` is another one as soon as there is something new, `now_ns` the wall time."""
        if news == self._drawn and now_ns < self._due_ns:
            return False
        self._drawn, self._due_ns = news, now_ns + self._idle_ns
        return True
