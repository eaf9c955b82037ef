"""The data of one control cycle: measurements, reference and commands. Nothing is computed here."""

from collections.abc import Sequence


class Cycle:
    """One cycle of control, filled step by step; one entry per joint in every sequence, which is a tuple.

    | fields | filled by | when |
    |---|---|---|
    | `position_rad`, `velocity_rad_s`, `current_a` | `JointInputs`, with the measurements | the inputs are complete |
    | the same | the arm watch, where it replaces a sensor | after that, before the law |
    | `tick`, `reference_rad` and its two derivatives | `ControlLoop.look_up` | before the law |
    | `feedforward_nm` | `ControlLoop.torque_nm` | before the law |
    | `applied_nm`, `saturated` | `ControlLoop.outputs` | after the law: it sees them in the next cycle |

    `feedforward_nm` is the feed-forward torque for this command; `applied_nm` is the part of the last command that the
    amplifier could deliver, and `saturated` whether that was less than asked for. A law has a copy of its own: its
    changes there do not affect what is recorded, reported or judged.
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
