"""How far and how fast the built-in motions move each joint of a cell.

Joints 2 and 3 of the paper's robot swing as in the paper, by 35 and 30 degrees about the home pose; any other joint as
far as its limits and its speed allow. The motion over time must not enter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

AMPLITUDE_DEG = (35.0, 30.0)
"""Amplitudes of the first joint, and of all others."""
PERIODS_S = (2.56, 1.7, 2.2, 1.9, 2.4, 1.8, 2.05)
"""Periods of the sine, joint by joint, repeated from the first: they differ, so that the arm passes many poses."""
MOST_OF_TRAVEL = 0.4
"""Largest amplitude as a share of the travel between the limits: a tenth is left at either end."""
MOST_OF_SPEED = 0.8
"""Highest peak speed of the sine as a share of the joint's highest speed."""


@dataclass(frozen=True, slots=True)
class Swing:
    """One joint goes `amplitude_deg` either way about `centre_deg`; a sine does in `period_s`."""

    centre_deg: float
    amplitude_deg: float
    period_s: float


def swings(
    home_deg: Sequence[float], low_deg: Sequence[float], high_deg: Sequence[float], speed_rad_s: Sequence[float]
) -> tuple[Swing, ...]:
    """The swing of each joint, about its home pose where there is room, from its limits and greatest speed."""
    found = []
    places = zip(home_deg, low_deg, high_deg, speed_rad_s, strict=True)
    for index, (home, low, high, speed) in enumerate(places):
        amplitude = min(AMPLITUDE_DEG[min(index, 1)], MOST_OF_TRAVEL * (high - low))
        margin = (0.5 - MOST_OF_TRAVEL) * (high - low)
        centre = min(max(home, low + margin + amplitude), high - margin - amplitude)
        shortest_s = 2.0 * math.pi * math.radians(amplitude) / (MOST_OF_SPEED * speed)
        found.append(Swing(centre, amplitude, max(PERIODS_S[index % len(PERIODS_S)], shortest_s)))
    return tuple(found)
