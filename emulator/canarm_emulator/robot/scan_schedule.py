"""When the sensors of a cell are sampled after a SYNC: the sequences of all its converters, merged in order of time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from .sensors import Source


@dataclass(frozen=True, slots=True, eq=False)
class ScanSchedule:
    """`sources` in the order of `offsets_ns`, the times after the start of the scan, which lasts `duration_ns`.

    Made once and used in every cycle; two schedules are compared by identity.
    """

    sources: tuple[Source, ...]
    offsets_ns: tuple[int, ...]
    origins: tuple[tuple[int, int], ...]
    """The sequence of each sample, and its index in it."""
    duration_ns: int

    @classmethod
    def merged(cls, sequences: Sequence[tuple[Sequence[Source], int]]) -> Self:
        """The schedule of converters that begin together; each has its sources in order, and the ns per conversion.

        At equal times, the sample of the earlier sequence comes first. Raises `ValueError` for a negative duration.
        """
        samples: list[tuple[int, Source, tuple[int, int]]] = []
        for number, (sources, conversion_ns) in enumerate(sequences):
            if conversion_ns < 0:
                raise ValueError(f"conversion_ns = {conversion_ns}: must be 0, for all at once, or more")
            samples += [(index * conversion_ns, source, (number, index)) for index, source in enumerate(sources)]
        samples.sort(key=lambda sample: sample[0])
        offsets_ns, sources_in_time, origins = zip(*samples, strict=True) if samples else ((), (), ())
        duration_ns = max((len(sources) * conversion_ns for sources, conversion_ns in sequences), default=0)
        return cls(sources_in_time, offsets_ns, origins, duration_ns)
