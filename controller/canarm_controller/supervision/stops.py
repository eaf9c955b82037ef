"""Joints at their end stops, which the nominal arm does not know: a stop takes what presses a joint into it.

An arm that nobody held lies on one. Owns the expectation; what a joint that strikes a stop means for its sensors does
not enter.
"""

from collections.abc import Sequence
from math import radians

import numpy as np

from canarm_protocol.cell.model import Cell

Rows = Sequence[Sequence[float]]


class Stops:
    """End stops of all joints of a cell. `moved_rad`: what noise does not make of an angle; `reach_rad`: how far each
    joint may turn at most until `look` is called again.
    """

    def __init__(self, cell: Cell, moved_rad: Sequence[float], reach_rad: Sequence[float]) -> None:
        lows_highs = [joint.limits_deg for joint in cell.joints]
        self._ends = [
            (radians(low) + moved, radians(high) - moved)
            for (low, high), moved in zip(lows_highs, moved_rad, strict=True)
        ]
        self._reach_rad = reach_rad
        self.near: list[int] = []
        """Joints that may be at a stop before `look` is called again."""

    def look(self, position_rad: Sequence[float]) -> None:
        """Bring `near` up to date."""
        rows = zip(position_rad, self._ends, self._reach_rad, strict=True)
        self.near = [
            index for index, (angle, (low, high), reach) in enumerate(rows) if not low + reach < angle < high - reach
        ]

    def side(self, index: int, angle_rad: float) -> int:
        """Which stop the joint is at: -1, 1, or 0 for none."""
        low, high = self._ends[index]
        return (angle_rad >= high) - (angle_rad <= low)

    def at(self, position_rad: Sequence[float]) -> list[tuple[int, int]]:
        """The joints that are at a stop, and which."""
        sides = [(index, self.side(index, position_rad[index])) for index in self.near]
        return [each for each in sides if each[1]]


def held(free_rad_s2: Sequence[float], pressed: Sequence[tuple[int, int]], mobility: Rows) -> list[float]:
    """Accelerations of one robot (rad/s²) of which the stops bear what presses these joints into them.

    `pressed` are joints and the sides of their stops, `mobility` M⁻¹, rotors included. A stop cannot pull: of those
    that would have to, the worst is left out until none is left.
    """
    free, inverse = np.array(free_rad_s2), np.array(mobility)
    pressed = [(joint, side) for joint, side in pressed if free[joint] * side > 0.0]
    while pressed:
        joints = [joint for joint, _ in pressed]
        borne_nm = np.linalg.solve(inverse[np.ix_(joints, joints)], -free[joints])
        pulls = [borne * side for borne, (_, side) in zip(borne_nm, pressed, strict=True)]
        worst = int(np.argmax(pulls))
        if pulls[worst] <= 0.0:
            return [float(each) for each in free + inverse[:, joints] @ borne_nm]
        del pressed[worst]
    return list(free_rad_s2)
