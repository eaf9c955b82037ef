"""The end of a run, for people and for programs."""

import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from canarm_controller.bus.assessment import JointFigures
from canarm_controller.supervision.detection import Detection
from canarm_protocol.cell.bench_objects import SETTLING_CYCLES
from canarm_protocol.shown import printable

IMPORTANT = ("detected ", "recorded ")
"""How the lines of a summary begin that a dashboard shows first."""
MOST_DETECTIONS = 8
"""A summary for people shows this many detections, the first ones."""


@dataclass(frozen=True, slots=True)
class Summary:
    """The summary of a run, as printed with `--json`."""

    cell: str
    law: str
    trajectory: str
    feedforward: str
    clock: str
    seed: int | None
    state: str
    reason: str | None
    ticks: int
    missed: int
    late: int
    real_time_factor: float | None
    starved: str | None = None
    """Why many cycles were skipped, if they were."""
    approach_s: float = 0.0
    """Duration of the approach to the first pose of a trajectory file, from cycle 0; the file begins after it."""
    joints: Mapping[str, JointFigures] = field(default_factory=dict)
    out: str | None = None
    faults: int | None = None
    """Number of faults that have begun; None if not known."""
    detections: Sequence[Mapping[str, Any]] = ()
    """The controller's detections, oldest first: detector, where, tick, reaction."""

    object: Mapping[str, Any] | None = None
    """Forces of two hands on the object that they carry, N, and which have lost it; None if the cell has none."""

    broke_off: bool = False
    """Whether its recording broke off, as on a full disk: the record is not whole."""

    def as_json(self) -> dict[str, Any]:
        """A JSON object, with numbers rounded to significant digits; `broke_off` is in it where it is true."""
        plain = {key: _rounded(value) for key, value in asdict(self).items()}
        if not self.broke_off:
            del plain["broke_off"]
        if self.object is None:
            del plain["object"]
        return plain

    def verdict_first(self) -> list[str]:
        """The lines of `as_text` for a screen with little room: the verdict, why it ended, what was detected and where
        it is recorded, then the others.
        """
        verdict, *details = self.as_text().splitlines()
        important = [line for line in details if line.startswith(IMPORTANT) or line in (self.reason, self.starved)]
        return [verdict, *important, *(line for line in details if line not in important)]

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.as_text())}</pre>"

    def as_text(self) -> str:
        """A few lines for a terminal."""
        speed = "" if self.real_time_factor is None else f", {self.real_time_factor:.3g} x real time"
        lines = [
            f"{self.state.upper()}: {self.cell}, {self.law} on {self.trajectory}, feed-forward {self.feedforward}, "
            f"clock {self.clock}",
            f"{self.ticks} cycles{speed}, {self.missed} missed, {self.late} late",
        ]
        if self.approach_s:
            lines.append(f"the trajectory begins at {self.approach_s:g} s, after a move to its first pose")
        lines[1:1] = [text for text in (self.starved, self.reason) if text]
        if self.joints:
            width = max(10, *(len(name) + 2 for name in self.joints))
            lines.append(
                f"{'joint':<{width}}{'RMS error':>12}{'max error':>12}{'peak current':>14}{'ripple':>9}  amplifier"
            )
        for name, joint in self.joints.items():
            saturated = (
                f"saturated in {joint.saturated_cycles} cycle{'s' * (joint.saturated_cycles != 1)}"
                if joint.saturated_cycles
                else "within its limit"
            )
            ripple = "-" if joint.speed_ripple is None else f"{100 * joint.speed_ripple:.1f} %"
            lines.append(
                f"{name:<{width}}{_lsb(joint.rms_lsb):>12}{_lsb(joint.max_lsb):>12}{joint.peak_current_a:>12.3f} A"
                f"{ripple:>9}  {saturated}"
            )
        if (
            self.joints
            and self.ticks <= SETTLING_CYCLES
            and all(joint.rms_lsb is None for joint in self.joints.values())
        ):
            lines.append(errors_count_later("--seconds"))
        if self.object is not None:
            lines.append(_grips(self.object))
        if self.faults:
            lines.append(f"{self.faults} {'fault has' if self.faults == 1 else 'faults have'} begun")
        for each in self.detections[:MOST_DETECTIONS]:
            where = "" if each["where"] is None else f" at {each['where']}"
            lines.append(f"detected in cycle {each['tick']}: {each['detector']}{where} ({each['reaction']})")
        if len(self.detections) > MOST_DETECTIONS:
            lines.append(f"and {len(self.detections) - MOST_DETECTIONS} detections more")
        if self.out:
            how = (
                "recorded in part: the recording broke off; what there is stands in"
                if self.broke_off
                else "recorded in"
            )
            lines.append(f"{how} {printable(self.out)}")
        return "\n".join(lines)


AFTER_STOP = "after the emergency stop at "


def after_emergency_stop(second: float, reason: str | None) -> str:
    """Why a run has ended in which an operator pressed the emergency stop at `second`: a controller sees the effect."""
    if reason is not None and reason.startswith(AFTER_STOP):
        return reason
    return f"{AFTER_STOP}{second:.3f} s" + (f": {reason}" if reason else "")


def errors_count_later(setting: str) -> str:
    """Why a run of `SETTLING_CYCLES` or fewer has no figure of its errors; `setting` is what makes it longer."""
    return (
        f"errors count after the first {SETTLING_CYCLES} cycles, in which the motion blends in: "
        f"take more of them ({setting})"
    )


def detections_as_plain(detections: Iterable[Detection]) -> tuple[dict[str, Any], ...]:
    """Detections as plain values for a summary."""
    return tuple(
        {"detector": each.detector, "where": each.where, "tick": each.tick, "reaction": each.reaction.value}
        for each in detections
    )


def _grips(figures: Mapping[str, Any]) -> str:
    lost = "".join(f", lost by the {hand}" for hand in figures["lost_by"])
    return (
        f"object: a grip's force reached {figures['grip_peak_n']:.3g} N of {figures['slip_force_n']:g} N, squeeze "
        f"{figures['squeeze_rms_n']:.2g} N RMS and {figures['squeeze_peak_n']:.2g} N at most{lost}"
    )


def _lsb(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f} LSB"


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    return float(f"{value:.5g}") if isinstance(value, float) else value
