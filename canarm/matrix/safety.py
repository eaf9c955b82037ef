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
"""The fault-tolerant time interval: for so long, from the clock's start on, an arm may be neither off, held nor near
its reference."""
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

    `safe_s` is from the first cycle, after the clock's start, in which the arm is in no safe state, to the one from
    which it is for good; None where it never is: an arm that follows is safe until it does so no more. `by` is in which
    state it ends, "off", "hold" or "tracking". `growth_rad_s` is by how much a joint without a brake has become faster
    than it was when the fault began, or than its twin is, until the safe state or the end of the FTTI; `braked_rad_s`
    the highest speed of a joint with a brake. `driven_w` is the most that a drive puts into the arm after its torque is
    off, over what its winding's decay allows.
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

    `holding` and `tracking` (n,) are where the arm stands after the controller has begun to stop, and where it is near
    its reference before that. Torque is off where every amplifier is asked for nothing.
    """
    off = np.asarray((motion.command_a == 0.0).all(axis=1))
    braked = np.array([joint.brake is not None for joint in cell.joints])
    # A motor that its brake shorts is a generator: that current no amplifier gives.
    given_a = np.where(braked & (motion.command_a == 0.0), 0.0, np.abs(motion.current_a))
    weak = np.asarray((given_a <= SAFE_CURRENT_A * _EXACT).all(axis=1))
    good = (off | holding | tracking) & weak
    bad = np.flatnonzero(~good)
    bad = bad[bad >= clock]
    lost, start = (int(bad[0]), int(bad[-1]) + 1) if len(bad) else (clock, clock)
    is_reached = start < len(good)
    safe_s = float(motion.time_s[start] - motion.time_s[lost]) if is_reached else None
    by = "" if not is_reached else "off" if off[-1] else "hold" if holding[-1] else "tracking"
    growth_rad_s = _growth_rad_s(motion, twin_rad_s, injected, range(clock, _until(motion, lost, start)), ~braked)
    braked_rad_s = float(np.abs(motion.speed_rad_s[clock:, braked]).max(initial=0.0))
    driven_w = _driven_w(cell, motion, int(np.flatnonzero(~off).max(initial=-1)) + 1)
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


def _until(motion: Motion, lost: int, start: int) -> int:
    """The row after the one in which the arm is safe for good; at the latest that after the FTTI."""
    in_ftti = motion.time_s[lost:] <= motion.time_s[lost] + FTTI_S * _EXACT
    return lost + min(start - lost + 1, int(np.count_nonzero(in_ftti)))


def _growth_rad_s(motion: Motion, twin_rad_s: Floats, injected: int, watched: range, joints: Bools) -> float:
    """By how much any of the `joints` is faster in the rows `watched` than before and after what happened at the
    injection, and than its twin: a joint that was hit has to catch up.
    """
    speed_rad_s, rows = np.abs(motion.speed_rad_s[:, joints]), slice(watched.start, watched.stop)
    before_rad_s = speed_rad_s[max(injected - 1, 0) : injected + 1].max(axis=0)
    growth_rad_s = speed_rad_s[rows] - np.maximum(before_rad_s, np.abs(twin_rad_s[rows, joints]))
    return float(growth_rad_s.max(initial=0.0))


def _driven_w(cell: Cell, motion: Motion, start: int) -> float:
    """The most power that a drive's current puts into the arm from row `start` on, if there is one: K_I·i·w where that
    is positive.

    A winding that has been switched off still has a current, which decays with L/R from what it was at most.
    """
    most_w = 0.0
    elapsed_s = motion.time_s[start:] - motion.time_s[start : start + 1]
    for number, joint in enumerate(cell.joints):
        motor, highest_a = joint.motor, joint.drive.max_current_a
        left = np.exp(-elapsed_s / (motor.winding_mh * 1e-3 / motor.winding_ohm)) + LEAK
        current_a = motion.current_a[start:, number]
        beyond_a = np.abs(current_a) - left * highest_a
        direction = np.sign(current_a) * motion.motor_speed_rad_s[start:, number]
        power_w: Floats = motor.torque_per_ampere * np.maximum(beyond_a, 0.0) * direction
        most_w = max(most_w, float(power_w.max(initial=0.0)))
    return most_w
