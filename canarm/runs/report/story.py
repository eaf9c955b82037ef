"""What has happened in a run, in words: how it ended, how it followed, which faults began and what noticed them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from canarm_emulator.serving.recording import RECORDING
from canarm_protocol.cell.bench_objects import SETTLING_CYCLES
from canarm_protocol.faults.fault_events import EMERGENCY_STOP
from canarm_protocol.shown import printable

from ...rig.findings import Noticed
from ...summary import errors_count_later
from ..run import Run
from .errors import largest_errors, settled_s

MOST_NAMED = 6
OVER = ("STOPPING", "DONE", "FAILED")
SAME_S = 1e-9
"""Times that differ by less are the same one."""
SETTLED = f" (the first {SETTLING_CYCLES} cycles left out)"


@dataclass(frozen=True)
class Span:
    """A fault, or an emergency stop, from its beginning to its end (None: the end of the run), and the first detection
    after it.
    """

    what: str
    begin_s: float
    end_s: float | None
    noticed: Noticed | None
    is_stop: bool = False
    is_late: bool = False
    """Whether it has begun when the run was over, and no controller was there to detect it."""

    @property
    def latency_ms(self) -> float | None:
        """From its beginning to the detection."""
        return None if self.noticed is None else max(0.0, self.noticed.time_s - self.begin_s) * 1e3


def spans_of(run: Run) -> list[Span]:
    """Faults and emergency stops of a run in the order of their beginnings.

    What is detected while the emergency stop is on is its doing, and answers no fault before it.
    """
    stops = _stops(run)

    def is_of_stop(seen: Noticed, after_s: float) -> bool:
        return any(
            after_s < stop.begin_s <= seen.time_s + SAME_S and (stop.end_s is None or seen.time_s <= stop.end_s)
            for stop in stops
        )

    faults = [
        replace(each, noticed=None) if each.noticed is not None and is_of_stop(each.noticed, each.begin_s) else each
        for each in _faults_of(run)
    ]
    return sorted([*faults, *stops], key=lambda each: each.begin_s)


def _stops(run: Run) -> list[Span]:
    found: list[Span] = []
    for each in run.event_list:
        if each["event"] != EMERGENCY_STOP:
            continue
        time_s, is_on = each["time_s"], each.get("state") == "on"
        is_pressed = bool(found) and found[-1].end_s is None
        if is_on and not is_pressed:
            seen = next((other for other in run.detections if other.time_s >= time_s - SAME_S), None)
            found.append(Span("emergency stop", time_s, None, seen, is_stop=True))
        elif not is_on and is_pressed:
            found[-1] = replace(found[-1], end_s=time_s)
    return found


def _faults_of(run: Run) -> list[Span]:
    begin_s, over_s, found = run.begin_s, _over_s(run), []
    ends = [each for each in run.faults if not each.is_begin]
    for each in (each for each in run.faults if each.is_begin):
        begun_s = each.time_ns * 1e-9 - begin_s
        end = next((other for other in ends if other.label == each.label and other.time_ns >= each.time_ns), None)
        if end is not None:
            ends.remove(end)
        seen = next((other for other in run.detections if other.time_s >= begun_s - SAME_S), None)
        end_s = None if end is None else end.time_ns * 1e-9 - begin_s
        found.append(Span(each.label, begun_s, end_s, seen, is_late=seen is None and begun_s >= over_s))
    return found


def _over_s(run: Run) -> float:
    """When the controller began to stop; infinite if it has not."""
    ends = (each["time_s"] for each in run.event_list if each["event"] == "state" and each.get("state") in OVER)
    return min(ends, default=math.inf)


def verdict(run: Run) -> tuple[bool, list[str]]:
    """Whether all went well, and sentences, the most important first. They are safe to show."""
    is_good, lines = _end(run)
    lines += [*_tracking(run), *_cycles(run), *_gaps(run), *_faults(run)]
    if run.complaints:
        lines.append(f"Its folder is not whole: {'; '.join(run.complaints)}.")
    return is_good and not run.complaints, lines


def joint_figures(run: Run) -> dict[str, dict[str, float]]:
    """The figures of each joint in the summary that are numbers, with safe names."""
    joints = run.summary.get("joints")
    found: dict[str, dict[str, float]] = {}
    for name, figures in joints.items() if isinstance(joints, dict) else ():
        if isinstance(figures, dict):
            known = {printable(str(key), 40): value for key, value in figures.items() if _is_number(value)}
            found[printable(str(name), 40)] = {key: float(value) for key, value in known.items()}
    return found


def _end(run: Run) -> tuple[bool, list[str]]:
    said = run.summary
    state, cycles, reason = said.get("state"), said.get("ticks"), run.reason
    length = f"after {cycles} cycles" if isinstance(cycles, int) else "after an unknown number of cycles"
    why = f": {printable(reason, 300)}" if reason else ""
    starved = [printable(str(said["starved"]), 300)] if said.get("starved") else []
    if state == "done":
        return not starved, [*starved, f"The run ended as planned {length}."]
    if state == "failed":
        return False, [*starved, f"The run ended in a safe stop {length}{why}."]
    if state == "interrupted":
        return False, [*starved, f"The run was interrupted {length}{why}."]
    rows = len(run.controller.get("cycle", ())) or len(run.robot.get("cycle", ()))
    return False, [f"The run has no summary: it goes on, or was killed. {rows} cycles are recorded."]


def _tracking(run: Run) -> Iterator[str]:
    is_counted = False
    for name, figures in joint_figures(run).items():
        rms, most, peak = (figures.get(key) for key in ("rms_lsb", "max_lsb", "peak_current_a"))
        if rms is not None and most is not None:
            current = "" if peak is None else f", with {peak:.3g} A at most"
            error = f"{most:.3g} steps of its sensor, {rms:.3g} RMS"
            yield f"{name} followed its reference within {error}{current}{SETTLED}."
            is_counted = True
        if figures.get("saturated_cycles"):
            yield f"{name}'s amplifier was at its limit in {figures['saturated_cycles']:.0f} cycles."
    cycles = run.summary.get("ticks")
    if not is_counted and isinstance(cycles, int) and 0 < cycles <= SETTLING_CYCLES:
        yield f"No error counts: {errors_count_later('--seconds')}."
    yield from _left_out(run)


def _left_out(run: Run) -> Iterator[str]:
    """What the figures do not tell of faults that have begun before errors count."""
    counts_s = settled_s(run)
    early = [each for each in spans_of(run) if not each.is_stop and not each.is_late and each.begin_s < counts_s]
    if not early:
        return
    first = early[0]
    errors = [
        f"{printable(name, 40)} erred by {most:.3g} {unit}" for name, most, unit in largest_errors(run, first.begin_s)
    ]
    is_within = first.end_s is not None and first.end_s <= counts_s
    others = f", and {len(early) - 1} more begin there" if len(early) > 1 else ""
    where = f"{printable(first.what)} {'lies' if is_within else 'begins'} in the part that is left out{others}"
    yield f"{where}{': from its begin on, ' if errors else ''}{', '.join(errors)}{' at most' if errors else ''}."


def _cycles(run: Run) -> Iterator[str]:
    missed, late = run.summary.get("missed"), run.summary.get("late")
    if isinstance(missed, int) and isinstance(late, int):
        yield (
            "No cycle was missed or late." if not missed and not late else f"{missed} cycles were missed, {late} late."
        )


def _gaps(run: Run) -> Iterator[str]:
    begin_s: float | None = None
    for each in run.event_list:
        if each["event"] == RECORDING and each.get("state") == "off":
            begin_s = each["time_s"] if begin_s is None else begin_s
        elif each["event"] == RECORDING and begin_s is not None:
            yield f"Frames and true signals were not recorded from {begin_s:.4f} s to {each['time_s']:.4f} s."
            begin_s = None
    if begin_s is not None:
        yield f"Frames and true signals were not recorded from {begin_s:.4f} s on."


def _faults(run: Run) -> Iterator[str]:
    spans = spans_of(run)
    for each in spans[:MOST_NAMED]:
        begun = "The emergency stop was pressed" if each.is_stop else f"{printable(each.what)} began"
        what = f"{begun} at {each.begin_s:.4f} s"
        if each.is_late:
            yield f"{what}, when the run was over: no controller was there to detect it."
        elif each.noticed is None:
            yield f"{what}; nothing was detected after it."
        else:
            where = f" at {printable(each.noticed.detection.where, 60)}" if each.noticed.detection.where else ""
            detector = printable(each.noticed.detection.detector, 60)
            yield f"{what} and was noticed after {each.latency_ms:.1f} ms by {detector}{where}."
    if len(spans) > MOST_NAMED:
        is_fault = not any(each.is_stop for each in spans[MOST_NAMED:])
        yield f"{len(spans) - MOST_NAMED} {'faults' if is_fault else 'faults and stops'} more began."
    if not spans and run.detections:
        yield f"{len(run.detections)} detections, though no fault was injected."
    elif not spans and run.event_list:
        yield "No fault was injected, and nothing was detected."


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e15
