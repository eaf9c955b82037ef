"""Whether a run is safe in time: what the drives do, as opposed to gravity. Faults and detectors are not known here.

Motion in, findings out; when the clock starts and when the controller begins to stop is decided elsewhere.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import Cell

from .evidence import Floats, Motion

Bools = NDArray[np.bool_]

FTTI_S = 0.1
"""The fault-tolerant time interval: "safe within the FTTI" counts from the clock's start."""
SAFE_CURRENT_A = 1.5
SAFE_SPEED_RAD_S = 3.0
"""A joint with a brake is never faster than this from the clock's start on."""
GROWTH_RAD_S = 1.5
"""Until the safe state is reached, in the FTTI, a joint's speed grows by no more than half of `SAFE_SPEED_RAD_S`."""
LEAK = 0.01
"""Residual current of a switched-off winding, besides its decay, as a share of the amplifier's highest current."""
_EXACT = 1.0 + 1e-9


@dataclass(frozen=True, slots=True)
class Safety:
    """The outcome of a run from the clock's start on; the defaults are for a run whose clock never starts.

    `safe_s` is from the clock's start to the lasting safe state, None if never reached; `by` is "off", "hold"
    or "tracking". `growth_rad_s` is by how much a joint without a brake has become faster than it was when the fault
    began, or than its twin is, until the safe state or the end of the FTTI; `braked_rad_s` the highest speed of a joint
    with a brake. `driven_w` is the most that a drive puts into the arm after its torque is off, over what its winding's
    decay allows.
    """

    safe_s: float | None = None
    by: str = ""
    growth_rad_s: float = 0.0
    braked_rad_s: float = 0.0
    current_a: float = 0.0
    driven_w: float = 0.0
    is_safe: bool = True

    @property
    def is_slow_enough(self) -> bool:
        """Whether every joint with a brake keeps its limit, as it must whatever breaks."""
        return self.braked_rad_s <= SAFE_SPEED_RAD_S


def safety(
    cell: Cell, motion: Motion, twin_rad_s: Floats, injected: int, clock: int, holding: Bools, tracking: Bools
) -> Safety:
    """Judge the `motion` from row `clock` on; `injected` is the row of the injection, `twin_rad_s` the twin's speeds.

    `holding` and `tracking` (n,) are where the arm stands after the controller has begun to stop, and where it goes on
    near its reference. Torque is off where every amplifier is asked for nothing. The state must last.
    """
    off = np.asarray((motion.command_a == 0.0).all(axis=1))
    braked = np.array([joint.brake is not None for joint in cell.joints])
    # A motor that its brake shorts is a generator: that current no amplifier gives.
    given_a = np.where(braked & (motion.command_a == 0.0), 0.0, np.abs(motion.current_a))
    weak = np.asarray((given_a <= SAFE_CURRENT_A * _EXACT).all(axis=1))
    good = (off | holding | tracking) & weak
    bad = np.flatnonzero(~good)
    start = max(clock, int(bad[-1]) + 1 if len(bad) else 0)
    is_reached = start < len(good)
    safe_s = float(motion.time_s[start] - motion.time_s[clock]) if is_reached else None
    by = "" if not is_reached else "off" if off[start] else "hold" if holding[start] else "tracking"
    growth_rad_s = _growth_rad_s(motion, twin_rad_s, injected, clock, start, ~braked)
    braked_rad_s = float(np.abs(motion.speed_rad_s[clock:, braked]).max(initial=0.0))
    driven_w = _driven_w(cell, motion, start) if by == "off" else 0.0
    return Safety(
        safe_s,
        by,
        growth_rad_s,
        braked_rad_s,
        current_a=float(given_a[clock:].max()),
        driven_w=driven_w,
        is_safe=safe_s is not None
        and safe_s <= FTTI_S * _EXACT
        and growth_rad_s <= GROWTH_RAD_S
        and braked_rad_s <= SAFE_SPEED_RAD_S
        and driven_w <= 0.0
        and bool(weak[clock:].all()),
    )


def _growth_rad_s(motion: Motion, twin_rad_s: Floats, injected: int, clock: int, start: int, joints: Bools) -> float:
    """By how much any of the `joints` becomes faster than before and after what happened at the injection, and than
    its twin: a joint that was hit has to catch up.
    """
    speed_rad_s = np.abs(motion.speed_rad_s[:, joints])
    before_rad_s = speed_rad_s[max(injected - 1, 0) : injected + 1].max(axis=0)
    in_ftti = motion.time_s[clock:] <= motion.time_s[clock] + FTTI_S * _EXACT
    until = clock + min(start - clock + 1, int(np.count_nonzero(in_ftti)))
    growth_rad_s = speed_rad_s[clock:until] - np.maximum(before_rad_s, np.abs(twin_rad_s[clock:until, joints]))
    return float(growth_rad_s.max(initial=0.0))


def _driven_w(cell: Cell, motion: Motion, start: int) -> float:
    """The most power that a drive's current puts into the arm from row `start` on: K_I·i·w where that is positive.

    A winding that has been switched off still has a current, which decays with L/R from what it was at most.
    """
    most_w = 0.0
    elapsed_s = motion.time_s[start:] - motion.time_s[start]
    for number, joint in enumerate(cell.joints):
        motor, highest_a = joint.motor, joint.drive.max_current_a
        left = np.exp(-elapsed_s / (motor.winding_mh * 1e-3 / motor.winding_ohm)) + LEAK
        current_a = motion.current_a[start:, number]
        beyond_a = np.abs(current_a) - left * highest_a
        direction = np.sign(current_a) * motion.motor_speed_rad_s[start:, number]
        power_w: Floats = motor.torque_per_ampere * np.maximum(beyond_a, 0.0) * direction
        most_w = max(most_w, float(power_w.max(initial=0.0)))
    return most_w
