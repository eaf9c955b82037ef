"""Two five-axis arms carry one object: a path in, ten joint paths out, or why not. No cell, no bus.

```python
import numpy as np
from canarm.cooperation import RHINO_XR, ArmPair, CarriedObject, circle, plan_cooperation

pair = ArmPair(
    master=RHINO_XR, slave=RHINO_XR, carried=CarriedObject(length_m=0.6), slave_base_m=(-0.28, -0.30, 0.0)
)
plan = plan_cooperation(pair, circle(), np.radians([0, -80, 90, -10, 90]))
plan.joint_rad      # (2001, 10), the master's five first, every 2.5 ms of a lap of 5 s
plan.checks()       # path and grasp errors, largest steps
plan.write_csv("lap.csv")
```

What is offered is described where it is made, in `canarm_controller.cooperation`; docs/rhino.md says what comes of it.
"""

from canarm_controller.cooperation import *  # noqa: F403
from canarm_controller.cooperation import __all__ as __all__
