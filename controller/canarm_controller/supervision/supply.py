"""What torque the supplies leave the drives at a speed: the winding's share and the back-EMF must fit into them.

Owns that bound of the expected torque; commands and measured currents do not enter.
"""

from collections.abc import Sequence

from .nominal import JointNominal


class Supply:
    """Bounds of all joints: along its direction, a bridge gives 0 ≤ i ≤ (V - K_e·ω)/R."""

    def __init__(self, joints: Sequence[JointNominal]) -> None:
        self._rows = [
            (
                (each.supply_v - each.max_current_a * each.winding_ohm) / each.back_emf_v_s_rad,
                each.supply_v,
                each.back_emf_v_s_rad,
                each.torque_per_ampere / each.winding_ohm,
            )
            for each in joints
        ]
        self._least_rad_s = min(full for full, *_ in self._rows)

    def is_short(self, speed_rad_s: Sequence[float]) -> bool:
        """Whether at any of these speeds (rad/s) a supply may not give all of its current."""
        least_rad_s = self._least_rad_s
        for speed in speed_rad_s:  # noqa: SIM110  a generator takes three times as long, in every cycle
            if not -least_rad_s <= speed <= least_rad_s:
                return True
        return False

    def driven_nm(self, torque_nm: Sequence[float], speed_rad_s: Sequence[float]) -> Sequence[float]:
        """The torques (N·m) that come of those that are commanded, at these speeds."""
        driven = list(torque_nm)
        for index, (torque, speed, row) in enumerate(zip(torque_nm, speed_rad_s, self._rows, strict=True)):
            full_rad_s, supply_v, emf_v_s, torque_per_volt = row
            along_rad_s = speed if torque > 0.0 else -speed
            if along_rad_s > full_rad_s:
                most = max(supply_v - emf_v_s * along_rad_s, 0.0) * torque_per_volt
                driven[index] = min(max(torque, -most), most)
        return driven
