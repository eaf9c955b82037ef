"""Two five-axis arms carry one object: a path of the master's tip in, ten joint paths out. After Lee, Suh, Suh and Kim.

- `arms`: Denavit-Hartenberg values; `kinematics`: forward kinematics, Jacobian; `closed_form`: its inverse;
- `paths`, `path_file`: what the tip is to follow; `carrying`: the object, and the slave's base;
- `master`: (5); `compliance`: STEPs 1 to 4, exact; `as_printed`: theirs, for comparison;
- `leading`, `supporting`, `planning`, `plan`: the flow charts, and what comes out; `limits`, `reasons`: refusals;
- `placing`: where the slave may stand.

Kinematics alone: no masses, drives, buses or clocks. Needs numpy, and of the house its errors and the schema of a cell.
"""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from ..errors import CooperationError
    from .arms import RHINO_XR, DhChain, FiveAxisArm
    from .as_printed import PrintedSteps, printed_steps
    from .carrying import ArmPair, CarriedObject, pair_of, seen_from
    from .closed_form import BRANCHES, Branch, Solutions, inverse, inverse_branch
    from .compliance import Posture, comply
    from .kinematics import forward, least_singular_value_m, position_jacobian
    from .limits import PlanLimits
    from .master import follow
    from .path_file import read_path
    from .paths import Path, arc, circle, line, through
    from .placing import POSTURES, Arrangement, ReachabilityMap, least_motion, reachability
    from .plan import CooperationPlan, PlanChecks
    from .planning import plan_cooperation
    from .reasons import Reason, RefusedPlanError

__all__ = [
    "BRANCHES",
    "POSTURES",
    "RHINO_XR",
    "ArmPair",
    "Arrangement",
    "Branch",
    "CarriedObject",
    "CooperationError",
    "CooperationPlan",
    "DhChain",
    "FiveAxisArm",
    "Path",
    "PlanChecks",
    "PlanLimits",
    "Posture",
    "PrintedSteps",
    "ReachabilityMap",
    "Reason",
    "RefusedPlanError",
    "Solutions",
    "arc",
    "circle",
    "comply",
    "follow",
    "forward",
    "inverse",
    "inverse_branch",
    "least_motion",
    "least_singular_value_m",
    "line",
    "pair_of",
    "plan_cooperation",
    "position_jacobian",
    "printed_steps",
    "reachability",
    "read_path",
    "seen_from",
    "through",
]

__getattr__ = loader(
    __name__,
    __all__,
    "..errors",
    ".reasons",
    ".arms",
    ".paths",
    ".kinematics",
    ".closed_form",
    ".carrying",
    ".compliance",
    ".limits",
    ".master",
    ".plan",
    ".planning",
    ".placing",
    ".as_printed",
    ".path_file",
)
