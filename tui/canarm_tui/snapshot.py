"""What the dashboard draws from: one immutable picture of the run, taken a few times per second.

Values only, in physical units. No frames, no clock, no words or colours.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.faults.run_plan import RunPlan

from .faults import FaultSignal
from .history import History


@dataclass(frozen=True, slots=True)
class JointNow:
    """A joint at one cycle: the newest whose reference is known, or the newest at all if none of the last 0.5 s is.

    While cycles stand still, it is the joint as the bench saw it last, and there is no reference and no
    measurement.

    What is not known is NaN. Errors are true minus reference angle in steps (LSB) of the joint's position sensor.
    """

    angle_rad: float = np.nan
    speed_rad_s: float = np.nan
    reference_rad: float = np.nan
    error_lsb: float = np.nan
    rms_lsb: float = np.nan
    max_lsb: float = np.nan
    current_a: float = np.nan
    command_a: float = np.nan
    saturation: int = 0
    """Sign of the amplifier's command where it is at its limit, else 0."""
    measured_rad: float = np.nan
    """Angle that the controller has measured."""
    limit_a: float = np.nan
    """Highest current of its amplifier."""
    code: int | None = None
    """Code of the DAC that gives the amplifier's command."""
    internals: tuple[float, ...] = ()
    """The law's own values."""


@dataclass(frozen=True, slots=True)
class Counters:
    """Frames since the dashboard started, and samples that should have come and did not."""

    received: int = 0
    unknown: int = 0
    malformed: int = 0
    dropped_samples: int = 0
    dropped_references: int = 0


@dataclass(frozen=True, slots=True)
class Report:
    """What the controller last said of itself: its tick, late cycles and state (a key of `CONTROLLER_STATES`)."""

    tick: int
    late: int
    state: int
    age_ns: int
    is_lost: bool = False
    """It had the robot, and has fallen silent: it was killed, or hangs."""


@dataclass(frozen=True, slots=True)
class Rates:
    """Cycles a second of bus time and of wall time over the last seconds of wall time, and the real-time factor.

    The real-time factor counts cycles of nominal length a wall second: below 1 the run is slower than it should be.
    """

    cycles_per_s: float
    cycles_per_wall_s: float
    real_time_factor: float


@dataclass(frozen=True, slots=True)
class BusNow:
    """The robot's bus as the wire model has it: load in the last second (0 to 1), error frames so far."""

    load: float
    error_frames: int


def _no_cycles() -> NDArray[np.int64]:
    return np.zeros(0, dtype=np.int64)


def _no_values() -> NDArray[np.float64]:
    return np.zeros((0, 0))


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The run as received so far.

    `age_ns` is the wall time since the last telemetry of the bench, None before the first. `cycles` (n,) and
    `error_lsb` (n, joints) are the samples of the window, oldest first; NaN where the reference is not known.
    `reported` (joints, 4) is what the controller last said of each joint: measured angle (rad) and speed (rad/s),
    current asked for (A), feed-forward torque (N m); `internals` (joints, 4) are the law's own quantities.
    `faults` is what the telemetry says of them, None before it does. `history` is all that is kept, of which the window
    is a part. `bus` is None without a wire model. The arrays are read-only.
    """

    joints: tuple[JointNow, ...]
    age_ns: int | None = None
    cycle: int | None = None
    rates: Rates | None = None
    report: Report | None = None
    counters: Counters = Counters()
    faults: FaultSignal | None = None
    cycles: NDArray[np.int64] = field(default_factory=_no_cycles)
    error_lsb: NDArray[np.float64] = field(default_factory=_no_values)
    window_cycles: int = 1
    reported: NDArray[np.float64] = field(default_factory=_no_values)
    internals: NDArray[np.float64] = field(default_factory=_no_values)
    history: History = field(default_factory=History)
    bus: BusNow | None = None
    law: str = ""
    """The controller's; empty if it is not known."""
    internal_names: tuple[str, ...] = ()
    """Of the law's own values; empty if they are not known."""
    plan: RunPlan | None = None
    run_ticks: int | None = None
    """How long the controller has followed its trajectory; None if it has said nothing."""
    replay: str = ""
    """Of a recorded run: where it is, and how fast it plays."""
