"""The interface of a control law, which the loop calls every cycle."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from canarm_protocol.cell.model import Control

from ..cycle import Cycle
from ..dynamics import Arm

__all__ = ["ControlLaw", "Cycle"]


class ControlLaw(ABC):
    """A servo controller for all joints of an arm: measured state in, joint torques out, once per cycle.

    A law of your own derives from this class in a file of its own and is named `path/to/file.py:ClassName`.

    - `name` is shown in reports;
    - `default_feedforward` is used unless the command line says otherwise;
    - `feedforward_excludes_inertia` is true for a law that already supplies J·q̈_d;
    - `takes_feedforward` is false for a law whose model supplies all of the torque: a table would count it twice;
    - `following_error_lsb` is the law's normal following error at a payload of ±50 %, in steps of the potentiometer:
      a joint whose error grows beyond twice that is stopped.
    """

    name: ClassVar[str]
    default_feedforward: ClassVar[Literal["none", "table", "online"]] = "none"
    feedforward_excludes_inertia: ClassVar[bool] = False
    takes_feedforward: ClassVar[bool] = True
    following_error_lsb: ClassVar[float] = 60.0

    @abstractmethod
    def __init__(self, arm: Arm, control: Control, period_s: float) -> None:
        """Take the nominal arm, the cell's gains and the cycle time."""

    @abstractmethod
    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        """Begin again at the measured state. `amplitude_rad` is half of the trajectory's peak to peak, per joint."""

    @abstractmethod
    def update(self, cycle: Cycle) -> Sequence[float]:
        """Joint torques in N·m for this cycle, `cycle.feedforward_nm` included: a list, tuple or array of numbers.

        Called once every `period_s`.
        """

    def shift(self, shift_rad: Sequence[float]) -> None:
        """From the next cycle on, positions and references are so much greater (rad): the joints have been homed.

        Nothing has moved. A law that keeps angles, not only errors, from cycle to cycle shifts them here.
        """
        return

    def internals(self) -> Mapping[str, Sequence[float]]:
        """Named internal values for display and recording, one entry per joint, with units in the names.

        Names are ASCII identifiers such as `bias_a`, and the same in every cycle.
        """
        return {}
