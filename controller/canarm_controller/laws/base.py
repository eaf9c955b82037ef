"""What a control law is: the interface that the loop calls every cycle. No law lives here."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from canarm_protocol.cell.model import Control

from ..dynamics import NominalArm


class Cycle:
    """What a law sees in one cycle, filled anew by the loop; one entry a joint in every sequence, which is a tuple.

    `feedforward_nm` is the feed-forward torque for this command; `applied_nm` is what the amplifier could deliver of
    the last command, and `saturated` whether that was less than asked for. A law has an object of its own: what it
    changes there changes nothing that is recorded, reported or judged.
    """

    __slots__ = (
        "applied_nm",
        "current_a",
        "feedforward_nm",
        "position_rad",
        "reference_rad",
        "reference_rad_s",
        "reference_rad_s2",
        "saturated",
        "tick",
        "velocity_rad_s",
    )

    def __init__(self, joint_count: int) -> None:
        zeros = (0.0,) * joint_count
        self.tick: int = 0
        self.reference_rad: Sequence[float] = zeros
        self.reference_rad_s: Sequence[float] = zeros
        self.reference_rad_s2: Sequence[float] = zeros
        self.position_rad: Sequence[float] = zeros
        self.velocity_rad_s: Sequence[float] = zeros
        self.current_a: Sequence[float] = zeros
        self.feedforward_nm: Sequence[float] = zeros
        self.applied_nm: Sequence[float] = zeros
        self.saturated: Sequence[bool] = (False,) * joint_count

    def copy_from(self, other: "Cycle") -> None:
        """Take all values of `other`."""
        self.tick = other.tick
        self.reference_rad = other.reference_rad
        self.reference_rad_s = other.reference_rad_s
        self.reference_rad_s2 = other.reference_rad_s2
        self.position_rad = other.position_rad
        self.velocity_rad_s = other.velocity_rad_s
        self.current_a = other.current_a
        self.feedforward_nm = other.feedforward_nm
        self.applied_nm = other.applied_nm
        self.saturated = other.saturated


class ControlLaw(ABC):
    """A servo controller for all joints of an arm: measured state in, joint torques out, once a cycle.

    A law of your own derives from this class in a file of its own and is named `path/to/file.py:ClassName`.

    - `name` is shown in reports;
    - `default_feedforward` is used unless the command line says otherwise;
    - `feedforward_excludes_inertia` is true for a law that already supplies J·q̈_d by itself;
    - `takes_feedforward` is false for a law whose own model supplies all of the torque: a table would count it twice;
    - `following_error_lsb` is the following error, in steps of the potentiometer, that is normal for the law at a
      payload of ±50 %: a joint that lags by more than twice as much, and ever more, is stopped.
    """

    name: ClassVar[str]
    default_feedforward: ClassVar[Literal["none", "table", "online"]] = "none"
    feedforward_excludes_inertia: ClassVar[bool] = False
    takes_feedforward: ClassVar[bool] = True
    following_error_lsb: ClassVar[float] = 60.0

    @abstractmethod
    def __init__(self, arm: NominalArm, control: Control, period_s: float) -> None:
        """Take the nominal arm, the cell's gains and the cycle time."""

    @abstractmethod
    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        """Begin anew at the measured state. `amplitude_rad` is the trajectory's, half of peak to peak, one a joint."""

    @abstractmethod
    def update(self, cycle: Cycle) -> Sequence[float]:
        """Joint torques in N·m for this cycle, `cycle.feedforward_nm` included: a list, tuple or array of numbers.

        Called once every `period_s`.
        """

    def internals(self) -> Mapping[str, Sequence[float]]:
        """Named inner values for display and recording, one entry a joint, units in the names; none by default.

        Names are ASCII identifiers such as `bias_a`, and the same in every cycle.
        """
        return {}
