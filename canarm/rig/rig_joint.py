"""Histories and figures of one joint of a rig, and questions about them for assertions.

`Source` hides where the values come from: the objects of this process, or the files of two others.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from canarm_controller.bus.assessment import JointFigures
from canarm_protocol.cell.bench_objects import SETTLING_CYCLES
from canarm_protocol.cell.cell_messages import near_and_all
from canarm_protocol.shown import printable, quoted

from ..usage import UsageError, check_number
from .findings import HALF_NS, Finding

Floats = NDArray[np.float64]

SIGNALS = ("true_angle_rad", "true_speed_rad_s", "current_a", "command_a", "reference_rad", "measured_rad")
TRUE_SIGNALS = 4
"""The first of `SIGNALS` are those of `canarm_emulator.robot.world.JointState`, in its order."""
ERROR_LSB = "error_lsb"
HISTORIES = (*SIGNALS, ERROR_LSB)
SETTLED = f"the first {SETTLING_CYCLES} cycles are left out; run() for longer"


class Span(NamedTuple):
    """A signal over cycles: their numbers, times in s, and values, each of shape (cycles,)."""

    cycle: NDArray[np.int64]
    time_s: Floats
    value: Floats


class UnknownJoint(UsageError, KeyError):
    """No joint has that name."""

    def __init__(self, name: object, names: Iterable[str]) -> None:
        super().__init__(f"no joint {quoted(name)}{near_and_all(name, names)}")

    def __str__(self) -> str:
        return str(self.args[0])  # a KeyError shows its repr


class Joints(dict[str, "RigJoint"]):
    """Joints by name. An unknown name raises `UnknownJoint`, a `KeyError`."""

    def __missing__(self, name: object) -> "RigJoint":
        __tracebackhide__ = True
        raise UnknownJoint(name, self)


class Source(Protocol):
    """The source of a run's course."""

    def column(self, joint: int, signal: str) -> Floats:
        """One of `SIGNALS`, or `time_s`, over the controlled cycles that are kept."""
        ...

    def span(self, joint: int, signal: str) -> Span:
        """As `column`, with cycle numbers and times; a true signal continues through the stop."""
        ...

    def figures(self, joint: int) -> JointFigures:
        """The figures of the run so far."""
        ...


class RigJoint:
    """Histories and figures of one joint.

    Histories are numpy arrays with one value per controlled cycle that is kept (`history_s` of `Rig`), oldest first,
    all of the same cycles; a stop adds none. They are copies, which do not change when the run goes on. Figures cover
    the whole run. A question about cycles that are no longer kept raises `UsageError`, unless a kept cycle answers it.
    """

    def __init__(self, source: Source, index: int, name: str, step_rad: float) -> None:
        self._source, self._index, self.name, self._step_rad = source, index, name, step_rad

    @property
    def time_s(self) -> Floats:
        """Virtual time of each SYNC."""
        return self._source.column(self._index, "time_s")

    @property
    def true_angle_rad(self) -> Floats:
        """True joint angle at each SYNC."""
        return self._source.column(self._index, "true_angle_rad")

    @property
    def true_speed_rad_s(self) -> Floats:
        """True joint speed at each SYNC."""
        return self._source.column(self._index, "true_speed_rad_s")

    @property
    def current_a(self) -> Floats:
        """Motor current at each SYNC, signed."""
        return self._source.column(self._index, "current_a")

    @property
    def command_a(self) -> Floats:
        """The commanded current from each SYNC on, signed."""
        return self._source.column(self._index, "command_a")

    @property
    def reference_rad(self) -> Floats:
        """The controller's reference for each SYNC."""
        return self._source.column(self._index, "reference_rad")

    @property
    def measured_rad(self) -> Floats:
        """The joint angle as the controller measured it in each cycle; where missing, the last one."""
        return self._source.column(self._index, "measured_rad")

    @property
    def error_lsb(self) -> Floats:
        """True minus reference angle at each SYNC, in steps of the position sensor."""
        return (self.true_angle_rad - self.reference_rad) / self._step_rad

    @property
    def rms_error_lsb(self) -> float:
        """RMS of true minus reference angle in steps of the position sensor, first 1024 cycles left out.

        Raises `UsageError` before: no comparison with it would mean anything.
        """
        __tracebackhide__ = True
        return self._figure("rms_error_lsb", self._source.figures(self._index).rms_lsb, SETTLED)

    @property
    def max_error_lsb(self) -> float:
        """Maximum of true minus reference angle, as `rms_error_lsb`."""
        __tracebackhide__ = True
        return self._figure("max_error_lsb", self._source.figures(self._index).max_lsb, SETTLED)

    @property
    def peak_current_a(self) -> float:
        """Peak motor current of the run, A."""
        return self._source.figures(self._index).peak_current_a

    @property
    def saturated_cycles(self) -> int:
        """Number of cycles in which the amplifier was at its limit."""
        return self._source.figures(self._index).saturated_cycles

    @property
    def speed_ripple(self) -> float:
        """Standard deviation over mean of the true speed while the reference speed is constant.

        Raises `UsageError` where it never is.
        """
        __tracebackhide__ = True
        why = "the reference has not moved at constant speed for long enough (trajectory='trapezoid' does)"
        return self._figure("speed_ripple", self._source.figures(self._index).speed_ripple, why)

    def known_figures(self) -> dict[str, float | None]:
        """The figures so far by the names that a summary gives them; None where one is not known yet."""
        found = self._source.figures(self._index)
        return {name: getattr(found, name) for name in ("rms_lsb", "max_lsb", "peak_current_a", "saturated_cycles")}

    def __repr__(self) -> str:
        known = self.known_figures()
        rms, most = known["rms_lsb"], known["max_lsb"]
        error = "no error counts yet" if rms is None or most is None else f"error {rms:.3g} LSB RMS, {most:.3g} at most"
        cycles = len(self._source.column(self._index, "time_s"))
        name, peak = printable(self.name, 60), f"peak current {self.peak_current_a:.3g} A"
        return f"<joint {name}: {cycles} cycles kept, {error}, {peak}>"

    def _figure(self, name: str, value: float | None, why: str) -> float:
        __tracebackhide__ = True
        if value is None:
            raise UsageError(f"{self.name}.{name}: not known: {why}")
        return value

    def stays_below(self, signal: str, limit: float, *, since: float = 0.0, until: float = math.inf) -> Finding:
        """Whether the magnitude of a history never passes `limit`, from `since` to `until` in s of virtual time.

        True signals (angle, speed, current, command) are checked through the stop too; `error_lsb` ends with the
        reference. Raises `UsageError` for a name that is no history, if no cycle lies in that time, and if it
        begins with cycles that are no longer kept and the others stay below.
        """
        __tracebackhide__ = True
        check_number("limit", limit, 0.0)
        return self._check(signal, -limit, limit, since, until)

    def stays_within(
        self, signal: str, low: float, high: float, *, since: float = 0.0, until: float = math.inf
    ) -> Finding:
        """As `stays_below`, for a signed value between `low` and `high`."""
        __tracebackhide__ = True
        return self._check(signal, low, high, since, until)

    def departure(self, signal: str, by: float, *, since: float) -> float | None:
        """When a history first differs from its value at `since` by more than `by`, in s of virtual time; None: never.

        Use it as the clock of a detection: a fault that freezes a signal shows only once the truth has moved on. Raises
        `UsageError` if the value at `since` is no longer kept.
        """
        __tracebackhide__ = True
        check_number("by", by, 0.0)
        check_number("since", since)
        span = self.span(signal)
        self._check_kept(signal, span, since)
        _, time_s, value = span
        after = time_s >= since - HALF_NS
        gone = after & (np.abs(value - value[after][:1]) > by) if after.any() else after
        return float(time_s[np.argmax(gone)]) if gone.any() else None

    def span(self, signal: str) -> Span:
        """A history with its cycles and times; a true signal continues through the stop. Raises `UsageError`."""
        __tracebackhide__ = True
        asked: object = signal
        if not isinstance(asked, str) or asked not in HISTORIES:
            raise UsageError(f"no history {quoted(asked)}{near_and_all(asked, HISTORIES)}")
        if signal == ERROR_LSB:
            return self._source.span(self._index, "reference_rad")._replace(value=self.error_lsb)
        return self._source.span(self._index, signal)

    def _check(self, signal: str, low: float, high: float, since: float, until: float) -> Finding:
        __tracebackhide__ = True
        for what, given in (("low", low), ("high", high), ("since", since), ("until", until)):
            check_number(what, given)
        if low > high:
            raise UsageError(f"low {low:g}: is above high, {high:g}: nothing lies between them")
        span = self.span(signal)
        chosen = (span.time_s >= since - HALF_NS) & (span.time_s <= until + HALF_NS)
        if not chosen.any():
            self._check_kept(signal, span, since)
            ran = f"there are those to {span.time_s[-1]:g} s" if len(span.time_s) else "run() first"
            raise UsageError(f"{self.name}.{signal}: no cycle from {since:g} s to {until:g} s; {ran}")
        cycle, time_s, value = (each[chosen] for each in span)
        bounds = f"must stay within {low:g} and {high:g}" if low != -high else f"must stay below {high:g}"
        # "not inside" rather than "outside", so that a NaN counts as bad.
        bad = np.flatnonzero(~((value >= low) & (value <= high)))
        if len(bad):
            first, kept = bad[0], " that are kept" if _is_cut(span, since) else ""
            return Finding(
                False,
                f"{self.name}.{signal} is {value[first]:.4g} at {time_s[first]:.4f} s (cycle {cycle[first]}), "
                f"and beyond in {len(bad)} of {len(value)} cycles{kept}; {bounds}",
            )
        self._check_kept(signal, span, since)
        extreme = value[np.argmax(np.abs(value))]
        return Finding(True, f"{self.name}.{signal} reaches {extreme:.4g} in {len(value)} cycles; {bounds}")

    def _check_kept(self, signal: str, span: Span, since: float) -> None:
        """Raises `UsageError` if cycles from `since` on are no longer in `span`."""
        __tracebackhide__ = True
        if _is_cut(span, since):
            raise UsageError(
                f"{self.name}.{signal}: cycles before {span.time_s[0]:.4f} s are no longer kept; ask about later ones "
                "with since=, or give the rig a longer history_s"
            )


def _is_cut(span: Span, since: float) -> bool:
    """Whether cycles from `since` on were dropped; the first cycle of a run is number 0."""
    return len(span.cycle) > 0 and bool(span.cycle[0] > 0) and since < span.time_s[0] - HALF_NS
