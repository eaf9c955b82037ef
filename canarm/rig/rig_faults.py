"""Fault injection in Python, whatever carries it out: an engine in this process, or a bench on a bus.

Which faults exist and where they are supported is not known here.
"""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from canarm_protocol.errors import CanarmError, FaultError
from canarm_protocol.faults.script import (
    FaultScript,
    FaultSet,
    ParameterValue,
    clearing,
    parse_faults,
    read_faults,
    script_of,
)
from canarm_protocol.shown import quoted

from ..usage import UsageError

FaultSource = Path | str | FaultScript
UNNAMED = "set "
"""Prefix of the names of unnamed sets."""
T = TypeVar("T")


class FaultControl(ABC):
    """Injecting, triggering and clearing faults. A refused request raises `FaultError` at once and changes nothing."""

    def __init__(self) -> None:
        self._names: set[str] = set()
        self._awaited: dict[str, None] = {}
        """Sets that have faults and were not cleared, in order."""

    @abstractmethod
    def _accept(self, script: FaultScript) -> None:
        """Carry out the whole `script`. Raises `FaultError` with the reason if it is refused."""

    def inject(
        self,
        tap: str,
        fault: str,
        *,
        at: float | None = None,
        cycle: int | None = None,
        when: str | None = None,
        manual: bool = False,
        duration: float | None = None,
        repeat: int = 1,
        period: float | None = None,
        name: str | None = None,
        **parameters: ParameterValue,
    ) -> str:
        """Inject one fault; returns the name of its set. Without a trigger it begins with the
        next cycle, or now while there are none.

        `at` and `cycle` count from the first SYNC after NMT start (s, cycles), `when` is a condition over true signals
        such as "joint2.angle_deg > 30", `manual` waits for `trigger()`. It lasts `duration` s, or until `clear()`;
        `repeat` activations in all begin `period` s apart. `canarm fault list` shows taps, faults and `parameters`.
        """
        __tracebackhide__ = True
        for what, word in (("tap", tap), ("fault", fault)):
            if not isinstance(word, str):
                raise FaultError(f"inject: {what} {quoted(word)}: must be a name; see `canarm fault list`")
        wanted = {"at": at, "cycle": cycle, "when": when, "duration": duration, "period": period}
        # A default is recognized by identity: 0 equals False, and True equals 1.
        wanted |= {"manual": None if manual is False else manual}
        wanted |= {"repeat": None if type(repeat) is int and repeat == 1 else repeat}
        name = name if name is not None else self._free_name(f"{tap} {fault}")
        entry = {key: value for key, value in wanted.items() if value is not None}
        spec = {**parameters, "tap": tap, "fault": fault}
        table = {"set": [{**entry, "name": name, "fault": [spec]}]}
        plainly(lambda: self._take(script_of(table, "inject")))
        return name

    def inject_file(self, source: FaultSource) -> tuple[str, ...]:
        """Inject a fault file (its path, or its text as TOML) or a script; returns the names of its sets."""
        __tracebackhide__ = True
        return plainly(lambda: self._take(self._named(read_script(source))))

    def trigger(self, name: str) -> None:
        """Begin a waiting set with the next cycle."""
        __tracebackhide__ = True
        if not isinstance(name, str):
            raise UsageError(f"trigger: {quoted(name)}: must be the name of a set")
        plainly(lambda: self._accept(FaultScript(trigger=name)))

    def clear(self, name: str | None = None) -> None:
        """End and forget the sets of that name; without a name, all sets."""
        __tracebackhide__ = True
        if not isinstance(name, str | None):
            raise UsageError(f"clear: {quoted(name)}: must be the name of a set; leave it out to clear all")
        plainly(lambda: self._accept(clearing(name)))
        for each in [name] if name else list(self._awaited):
            self._awaited.pop(each, None)

    def _named(self, script: FaultScript) -> FaultScript:
        """`script`, with unique names for its unnamed sets."""
        named = [
            replace(each, name=self._free_name(each.name)) if each.name.startswith(UNNAMED) else each
            for each in script.sets
        ]
        return replace(script, sets=tuple(named))

    def _take(self, script: FaultScript) -> tuple[str, ...]:
        self._accept(script)
        self._names |= {each.name for each in script.sets}
        self._awaited |= {each.name: None for each in script.sets if each.faults}
        return tuple(each.name for each in script.sets)

    def _free_name(self, wanted: str) -> str:
        names = itertools.chain((wanted,), (f"{wanted} #{number}" for number in itertools.count(2)))
        return next(name for name in names if name not in self._names)


def plainly(call: Callable[[], T]) -> T:
    """The result of `call`. A refusal is raised without our own stack frames."""
    __tracebackhide__ = True
    try:
        return call()
    except CanarmError as error:
        raise error.with_traceback(None) from None


def overdue(late: FaultSet, time_s: float, cycle: int) -> FaultError:
    """The refusal of a set whose time is over: it is `time_s`, in `cycle`."""
    at_s = late.trigger.at_s
    given = f"cycle = {late.trigger.cycle}" if at_s is None else f"at = {at_s:g} s"
    return FaultError(
        f"set {quoted(late.name)}: {given} is over: it is {time_s:.4f} s, in cycle {cycle}; to begin now, leave it out"
    )


def read_script(source: FaultSource) -> FaultScript:
    """The script in a file or text: a `Path`, or a line without "=" and "[", is a file. Raises `FaultError`."""
    if isinstance(source, FaultScript):
        return source
    if isinstance(source, str) and (not source.strip() or any(sign in source for sign in "=[\n")):
        return parse_faults(source, "faults")
    if not isinstance(source, str | Path):
        raise FaultError(f"faults: {quoted(source)}: must be a fault file, its text as TOML, or a script")
    return read_faults(Path(source))
