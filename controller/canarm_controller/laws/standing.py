"""Holds the torque while the arm is to stand still: static friction then keeps the joint.

Without this, noise and rounding move the command by a step or two of the DAC in every cycle, and reverse the bridge
again and again where gravity needs no torque.
"""

from collections.abc import Sequence

from .base import Cycle


class StandingHold:
    """Freezes a joint's torque while the joint is close to its set-point and no joint is to move.

    A joint comes close within half of `band_rad`, and stays close within all of it. A band of 0 never holds. The law
    gives the deviation, which should be filtered, or noise leads out of the band.
    """

    __slots__ = ("_band_rad", "_held_nm")

    def __init__(self, band_rad: float, joint_count: int) -> None:
        self._band_rad = band_rad
        self._held_nm: list[float | None] = [None] * joint_count

    def start(self) -> None:
        """Hold nothing."""
        self._held_nm = [None] * len(self._held_nm)

    def apply(self, cycle: Cycle, deviation_rad: Sequence[float], torque_nm: Sequence[float]) -> list[float]:
        """The torques to command, N·m: the law's or the held ones."""
        if not self._band_rad or any(cycle.reference_rad_s) or any(cycle.reference_rad_s2):
            self.start()
            return list(torque_nm)
        held_nm = self._held_nm
        for joint, (deviation, torque) in enumerate(zip(deviation_rad, torque_nm, strict=True)):
            held = held_nm[joint]
            if held is None:
                if abs(deviation) < 0.5 * self._band_rad:
                    held_nm[joint] = torque
            elif abs(deviation) > self._band_rad:
                held_nm[joint] = None
        return [torque if held is None else held for held, torque in zip(held_nm, torque_nm, strict=True)]

    def is_held(self, joint: int) -> bool:
        """Whether the joint's torque was held in the last cycle; nothing should adapt meanwhile."""
        return self._held_nm[joint] is not None
