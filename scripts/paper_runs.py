"""The runs behind docs/papers.md: the first paper's experiment, with and without compensation and adaptation."""

from dataclasses import dataclass

import numpy as np

from canarm.rig.rig import Rig
from canarm.study.plan import Settings
from canarm_controller.errors import TrajectoryError
from canarm_controller.reference.built_in import AMPLITUDE_DEG
from canarm_controller.reference.limits import Limits
from canarm_controller.reference.trajectory import Trapezoid, make_trajectory
from canarm_protocol.cell.bench_objects import SETTLING_CYCLES
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.sensing import position_steps_rad

TABLE_S = 10.24
"""4096 samples of 2.5 ms: what $2000 to $3FFF hold for each of two joints."""
PAYLOADS = {"right": 0.6, "+50 %": 0.9}
FIXED, ADAPTIVE = "pd", "mras"
BLEND_S = 0.15
PERIODS_S = tuple(round(5.12 - 0.08 * step, 2) for step in range(60))


@dataclass(frozen=True)
class Case:
    """One run: law, feed-forward, motion, the true mass of the last link, and for how long."""

    law: str
    feedforward: str
    trajectory: str
    mass_kg: float = 0.6
    seconds: float = TABLE_S

    @property
    def command(self) -> str:
        """The command that repeats it."""
        truth = () if self.mass_kg == PAYLOADS["right"] else (("joint3.mass", f"{self.mass_kg:g}"),)
        return Settings(
            law=self.law, trajectory=self.trajectory, feedforward=self.feedforward, seconds=self.seconds, truth=truth
        ).command


@dataclass(frozen=True)
class Outcome:
    """Of the worse joint: error in steps of its sensor, ripple of its speed, roughness in rad/s², peak current in A.

    `rms_lsb` has a value for each stretch of `TABLE_S`. Ripple and roughness (the RMS of the acceleration) are those on
    the stretches of constant speed; NaN for a motion without any. The first 1024 cycles are left out.
    """

    rms_lsb: tuple[float, ...]
    ripple: float
    roughness_rad_s2: float
    peak_a: float


def cases() -> list[Case]:
    """Every run of the page."""
    of_both = [
        Case(law, feedforward, trajectory, mass_kg)
        for trajectory in ("trapezoid", "sine")
        for mass_kg in PAYLOADS.values()
        for law in (FIXED, ADAPTIVE)
        for feedforward in ("none", "table")
    ]
    online = [Case(FIXED, "online", "sine")]
    longer = [Case(FIXED, "table", trajectory, seconds=2 * TABLE_S) for trajectory in ("sine", "trapezoid")]
    return of_both + online + longer


def outcome(case: Case) -> Outcome:
    """Run it."""
    truth = {"joint3.mass": case.mass_kg}
    with Rig(
        "konkuk1", case.law, case.trajectory, feedforward=case.feedforward, truth=truth, history_s=case.seconds
    ) as rig:
        rig.run(case.seconds)
        period_s, count = rig.cell.bus.cycle_s, rig.controller.controlled_ticks
        steady = rig.controller.loop.trajectory.constant_speed(0, count, period_s)[:-1]
        steady[:SETTLING_CYCLES] = False
        rms, rough = [], []
        steps_rad = position_steps_rad(rig.cell)
        for index, (joint, step_rad) in enumerate(zip(rig.joints.values(), steps_rad, strict=True)):
            off = (joint.true_angle_rad - joint.reference_rad) / step_rad
            parts = np.split(off, range(4096, count, 4096))
            rms.append([float(np.sqrt(np.mean(part[SETTLING_CYCLES:] ** 2))) for part in parts])
            acceleration = np.diff(joint.true_speed_rad_s)[steady[:, index]] / period_s
            rough.append(float(np.sqrt(np.mean(acceleration**2))) if len(acceleration) else np.nan)
        figures = rig.summary().joints.values()
    ripple = max((each.speed_ripple for each in figures if each.speed_ripple), default=float("nan"))
    peak_a = max(each.peak_current_a for each in figures)
    return Outcome(tuple(np.max(rms, axis=0).tolist()), ripple, max(rough), peak_a)


def fastest() -> tuple[float, str]:
    """The shortest period in s of the trapezoid that nominal arm, amplifiers and sensors allow, and what ends it."""
    cell = load_cell("konkuk1")
    limits = Limits.of(cell)
    assert make_trajectory("trapezoid", cell)
    centre = [joint.home_deg for joint in cell.joints]
    low, high = ([c + way * a for c, a in zip(centre, AMPLITUDE_DEG, strict=True)] for way in (-1.0, 1.0))
    last = PERIODS_S[0]
    for period_s in PERIODS_S:
        try:
            limits.check(Trapezoid(limits, low, high, period_s, BLEND_S), 2 * period_s, "trapezoid")
        except TrajectoryError as error:
            return last, str(error).partition("): ")[2]
        last = period_s
    return last, "nothing"
