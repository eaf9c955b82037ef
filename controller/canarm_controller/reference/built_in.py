"""How far and how fast the built-in motions move each joint of a cell.

For joints 2 and 3 of the paper's robot they are the paper's: 35 and 30 degrees about the home pose. Any other joint
swings likewise as far as its limits and its speed let it. What a motion looks like over time must not enter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

AMPLITUDE_DEG = (35.0, 30.0)
"""Of the first joint, and of all others."""
PERIODS_S = (2.56, 1.7, 2.2, 1.9, 2.4, 1.8, 2.05)
"""Of the sine, joint by joint and then again from the first: different ones, so that the arm comes by many poses."""
MOST_OF_TRAVEL = 0.4
"""Half a swing is at most this share of what lies between the limits: a tenth is left at either end."""
MOST_OF_SPEED = 0.8
"""The sine's peak speed is at most this share of what the joint can be followed at."""


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
