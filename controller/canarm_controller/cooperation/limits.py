"""How close to a singularity or limit a plan may come before it is refused."""

import math
from dataclasses import dataclass, fields

from ..errors import CooperationError
from .compliance import LEAST_CROSSING


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanLimits:
    """Where a plan ends; the joints' own limits are the arms'.

    - `least_singular_value_m`: of the master's position Jacobian, m/rad; not looked at where (5) is damped;
    - `least_crossing`: ‖a_o × h‖; the slave's wrist turns 1/‖a_o × h‖ times as fast as the object;
    - `least_axis_distance_m`: of B from the axis of the slave's base;
    - `least_elbow_sine`: |sin θ₃| of the slave, which is straight or folded at 0;
    - `largest_step_deg`: of any joint from one pose to the next;
    - `largest_path_error_m`: of the master's tip.
    """

    least_singular_value_m: float = 0.03
    least_crossing: float = LEAST_CROSSING
    least_axis_distance_m: float = 0.01
    least_elbow_sine: float = 0.05
    largest_step_deg: float = 5.0
    largest_path_error_m: float = 1e-4

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not 0.0 <= value < math.inf:
                raise CooperationError(f"{each.name} = {value}; must be 0 or more, and finite")
