"""How far what a detector watches can get at all, by what a joint's drive, travel and sensors have.

A limit beyond it is one at which the detector never speaks. Limits themselves are derived in `thresholds`.
"""

import math
from dataclasses import dataclass

from canarm_protocol.cell.model import Joint

from .nominal import JointNominal


@dataclass(frozen=True, slots=True)
class Reach:
    """The most that there can be of each quantity at one joint."""

    angle_rad: float
    """From one stop to the other."""
    speed_rad_s: float
    """From one end of what the tachometer shows to the other."""
    driven_rad_s: float
    """The speed at which the back-EMF is the supply."""
    acceleration_rad_s2: float
    """The whole drive turned round, or the weight alone."""
    current_a: float

    @classmethod
    def of(cls, nominal: JointNominal, joint: Joint) -> "Reach":
        """Of a joint, from its nominal figures and its stops."""
        drive_nm = nominal.torque_per_ampere * nominal.max_current_a
        low, high = joint.limits_deg
        return cls(
            angle_rad=math.radians(high - low),
            speed_rad_s=2.0 * nominal.fastest_rad_s,
            driven_rad_s=nominal.supply_v / nominal.back_emf_v_s_rad,
            acceleration_rad_s2=max(2.0 * drive_nm * nominal.mobility_per_kg_m2[1], nominal.falling_rad_s2),
            current_a=nominal.max_current_a,
        )

    def beyond_travel(self, limit_rad: float) -> str:
        """What to say of a limit of an angle, nothing if it can be exceeded; likewise below."""
        return _never(limit_rad, self.angle_rad, f"from stop to stop it is {math.degrees(self.angle_rad):.3g} deg")

    def beyond_tachometer(self, limit_rad_s: float) -> str:
        """Of a limit of a speed's error."""
        return _never(
            limit_rad_s, self.speed_rad_s, f"the tachometer shows {self.speed_rad_s:.3g} rad/s from end to end"
        )

    def beyond_supply(self, limit_rad_s: float) -> str:
        """Of a speed, which a falling arm may reach all the same."""
        if limit_rad_s <= self.driven_rad_s:
            return ""
        return f"; the supply drives it to {self.driven_rad_s:.3g} rad/s at most: only a fall or a blow shows"

    def beyond_drive(self, limit_rad_s2: float, when: str = "") -> str:
        """Of an acceleration, which a blow may make all the same; `when` it is that limit."""
        if limit_rad_s2 <= self.acceleration_rad_s2:
            return ""
        most = f"{self.acceleration_rad_s2:.3g} rad/s2"
        return f"; {when}weight or drive, turned round, make {most} at most: only a blow shows"

    def beyond_amplifier(self, limit_a: float, when: str = "") -> str:
        """Of a current; `when` it is that limit."""
        return _never(limit_a, self.current_a, f"the amplifier gives {self.current_a:.3g} A at most", when)


def _never(limit: float, most: float, words: str, when: str = "") -> str:
    return "" if limit <= most else f"; {when}never speaks here: {words}"
