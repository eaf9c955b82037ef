"""The detections of a run, without repetitions. Reactions never enter."""

from ..supervision.detection import Detection

REPEAT_CYCLES = 400
"""Repeated detections at one place are logged once in this many cycles, a second at 2.5 ms."""


class DetectionLog:
    """The detections of one run, oldest first."""

    def __init__(self) -> None:
        self.entries: list[Detection] = []
        self._last: dict[tuple[str, str | None], int] = {}

    def note(self, detection: Detection, is_news: bool) -> Detection | None:
        """The detection, if it is noted: one that `is_news`, or that was not there within the last second."""
        key, tick = (detection.detector, detection.where), detection.tick
        is_repeated = tick - self._last.get(key, -REPEAT_CYCLES) < REPEAT_CYCLES
        self._last[key] = tick
        if is_repeated and not is_news:
            return None
        self.entries.append(detection)
        return detection
