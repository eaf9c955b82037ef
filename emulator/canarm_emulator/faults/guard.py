"""Guards the bench against faults: an exception or an impossible result of a fault does not take the bench down.

A guarded fault that fails does nothing from then on, and the failure is reported once; the engine ends it.
"""

import math
import traceback
from collections.abc import Callable, Iterable
from typing import Any

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.shown import quoted

from ..robot.truth import JointTruth
from .declaration import Fault, NodeHandle

LONGEST = 300
"""Longest text of a failure, in characters."""


def guard(fault: Fault, report: Callable[[Exception], None]) -> None:
    """Check every call of `fault` by the bench. `report` is called with the first failure."""
    has_failed = False

    def guarded(call: Callable[..., Any], neutral: Callable[..., Any], checked: Callable[[Any], Any]) -> Any:
        def called(*arguments: Any) -> Any:
            nonlocal has_failed
            if arguments and isinstance(arguments[0], NodeHandle):
                arguments = (_GuardedHandle(arguments[0], guarded), *arguments[1:])
            if not has_failed:
                try:
                    return checked(call(*arguments))
                except Exception as error:
                    has_failed = True
                    report(error)
            return neutral(*arguments)

        return called

    for name, (neutral, checked) in _CALLS.items():
        call = getattr(fault, name, None)
        if call is not None:
            object.__setattr__(fault, name, guarded(call, neutral, checked))


class _GuardedHandle:
    """A node's handle that checks the filters of a fault like its own calls."""

    def __init__(self, handle: NodeHandle, guarded: Callable[..., Callable[..., Any]]) -> None:
        self._handle, self._guarded = handle, guarded

    def __getattr__(self, name: str) -> Any:
        return getattr(self._handle, name)

    def set_sync_filter(self, passes: Callable[[int], bool] | None) -> None:
        self._handle.set_sync_filter(passes and self._guarded(passes, lambda now_ns: True, bool))

    def set_send_filter(self, passes: Callable[[Frame], Frame | None] | None) -> None:
        self._handle.set_send_filter(passes and self._guarded(passes, lambda frame: frame, _frame))


def failure_text(fault: Fault, error: Exception) -> str:
    """What went wrong, and where: the innermost line of the fault's own file, else the innermost of all."""
    file = type(fault).declared_at.rpartition(":")[0]
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if frame.filename == file]
    where = [f"{frame.filename}:{frame.lineno}" for frame in (own or frames)[-1:]] or [type(fault).declared_at]
    return f"failed: {' '.join(f'{type(error).__name__}: {error}'.split())[:LONGEST]} ({where[0]})"


def _number(value: Any) -> Any:
    try:
        is_none = math.isnan(value)
    except TypeError:
        raise TypeError(f"apply() returned {quoted(value)}: must be a number") from None
    if is_none:
        raise ValueError("apply() returned nan: must be a number")
    return value


def _joint(value: Any) -> JointTruth:
    if not isinstance(value, JointTruth):
        raise TypeError(f"change() returned {quoted(value)}: must be a JointTruth")
    return value


def _stamped(frames: Iterable[Any]) -> list[tuple[int, Frame]]:
    """The frames as a list: a generator could fail outside the guard."""
    found = list(frames)
    for each in found:
        time_ns, frame = each if isinstance(each, tuple) and len(each) == 2 else (None, None)
        if not isinstance(time_ns, int) or not isinstance(frame, Frame):
            raise TypeError(f"{quoted(each)} was to go on: must be a pair of a time in ns and a Frame")
    return found


def _frame(value: Any) -> Any:
    if value is not None and not isinstance(value, Frame):
        raise TypeError(f"the send filter returned {quoted(value)}: must be a Frame, or None for a lost one")
    return value


def _period(value: Any) -> int:
    if not isinstance(value, int) or value <= 0:
        raise TypeError(f"period_ns() returned {quoted(value)}: must be a whole number of ns, greater than 0")
    return value


def _as_it_is(value: Any) -> Any:
    return value


def _nothing(*arguments: object) -> None:
    return None


_CALLS: dict[str, tuple[Callable[..., Any], Callable[[Any], Any]]] = {
    "begin": (_nothing, _as_it_is),
    "apply": (lambda value, now_ns: value, _number),
    "change": (lambda joint, now_ns: joint, _joint),
    "strike": (_nothing, _as_it_is),
    "pass_on": (lambda frame, now_ns: ((now_ns, frame),), _stamped),
    "due": (lambda until_ns: (), _stamped),
    "rest": (lambda now_ns: (), _stamped),
    "act": (_nothing, _as_it_is),
    "end": (_nothing, _as_it_is),
    "period_ns": (lambda nominal_ns, now_ns: nominal_ns, _period),
}
"""The bench's calls by name: the replacement once the fault has failed, and the check of its results."""
