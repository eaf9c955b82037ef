"""The bench's catalogue of faults; finding a tap or a fault by a few letters; and the text of a fault set.

The bench decides whether a value is allowed: typed text is passed on.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from canarm_protocol.errors import FaultError
from canarm_protocol.faults.fault_toml import as_toml
from canarm_protocol.faults.script import LONGEST_S, ParameterValue, script_of

IDENTIFIER = "cob_id"
"""Parameters of this name are shown in hexadecimal."""
AFTER, WHEN, MANUAL = "after", "when", "manual"
SCHEDULE = {
    "duration": "s; until it is cleared unless given",
    "repeat": "times in all, each of that duration",
    "period": "s from one beginning to the next",
    "at": "s after cycle 0; at once unless given",
    AFTER: "s from now, in a run that goes on",
    "cycle": "with that cycle",
    WHEN: "joint2.angle_deg > 30 and time_s > 1",
    MANUAL: "yes: waits for x, then t",
}
"""When a fault acts: what can be typed, by the key of a set but for `after`."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a fault at a tap: its default as typed, "" if the fault computes it; bounds as text."""

    name: str
    about: str
    default: str
    bounds: str


@dataclass(frozen=True, slots=True)
class FaultKind:
    """A fault that a tap supports."""

    name: str
    about: str
    needs_wire: bool
    parameters: tuple[Parameter, ...]

    @property
    def sought(self) -> str:
        """Where words are looked for beside the name."""
        return self.about


@dataclass(frozen=True, slots=True)
class Tap:
    """A place on the signal path."""

    name: str
    about: str
    faults: tuple[FaultKind, ...]

    @property
    def sought(self) -> str:
        """Where words are looked for beside the name."""
        return " ".join([self.about, *(each.name for each in self.faults)])


class Named(Protocol):
    """Something that can be searched for."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def sought(self) -> str:
        """Where words are looked for beside the name."""


N = TypeVar("N", bound=Named)


def catalogue_of(plain: Iterable[Mapping[str, Any]]) -> tuple[Tap, ...]:
    """The bench's FAULT_CATALOGUE as values. Raises `KeyError` or `TypeError` if malformed."""
    return tuple(Tap(tap["tap"], tap["about"], tuple(_kind(each) for each in tap["faults"])) for tap in plain)


def matching(entries: Iterable[N], typed: str) -> tuple[N, ...]:
    """Those whose name contains every typed word, in any order; after them those whose
    description does (for a tap, also the names of its faults).
    """
    words = typed.lower().split()
    entries = tuple(entries)
    by_name = [each for each in entries if all(word in each.name.lower() for word in words)]
    by_both = [each for each in entries if all(word in f"{each.name} {each.sought}".lower() for word in words)]
    return *by_name, *(each for each in by_both if each not in by_name)


def injection(
    tap: str,
    fault: FaultKind,
    typed: Mapping[str, str],
    schedule: Mapping[str, str],
    taken: Collection[str],
    now_s: float | None = None,
) -> str:
    """The text of a set with one fault; an empty field, or one with the default, is left out.

    `schedule` says when it acts, by the keys of `SCHEDULE`; `taken` are the names of existing sets; `now_s` is the time
    since cycle 0 of the run that goes on, None without one. Raises `FaultError` if no fault set can express what was
    typed.
    """
    usual = {each.name: each.default for each in fault.parameters}
    given = {name: text.strip() for name, text in typed.items()}
    spec = {name: _value(text) for name, text in given.items() if text not in ("", usual[name])}
    entry: dict[str, Any] = {"name": _free_name(f"{tap} {fault.name}", taken), **_times(schedule, now_s)}
    table = {"set": [{**entry, "fault": [{**spec, "tap": tap, "fault": fault.name}]}]}
    try:
        return as_toml(script_of(table, "inject"))
    except FaultError as error:
        raise FaultError(str(error).partition("): ")[2] or str(error)) from None


def _times(schedule: Mapping[str, str], now_s: float | None) -> dict[str, Any]:
    """The keys of a set, of what was typed."""
    given = {key: text.strip() for key, text in schedule.items() if text.strip()}
    times: dict[str, Any] = {key: text if key == "when" else _value(text) for key, text in given.items()}
    if AFTER in times:
        after = times.pop(AFTER)
        if "at" in times:
            raise FaultError("has at and after; must have one of them")
        if now_s is None:
            raise FaultError(f"after = {after}: no run goes on; at counts from cycle 0 of the next one")
        if isinstance(after, str) or not 0.0 <= after <= LONGEST_S:
            raise FaultError(f"after = {after}: must be a number of seconds, at least 0, at most {LONGEST_S:g}")
        times["at"] = now_s + after
    if MANUAL in times:
        if given[MANUAL].lower() not in ("yes", "y", "true", "no", "n", "false"):
            raise FaultError(f"manual = {given[MANUAL]}: must be yes or no")
        times[MANUAL] = given[MANUAL].lower()[0] in "yt"
        if not times[MANUAL]:
            del times[MANUAL]
    return times


def _kind(plain: Mapping[str, Any]) -> FaultKind:
    parameters = tuple(_parameter(each) for each in plain["parameters"])
    return FaultKind(plain["fault"], plain["about"], plain["needs_wire"], parameters)


def _parameter(plain: Mapping[str, Any]) -> Parameter:
    name, about, default = plain["name"], plain["about"], plain["default"]
    if "choices" in plain:
        return Parameter(name, about, _number(default), " | ".join(plain["choices"]))
    low, high = plain["minimum"], plain["maximum"]
    if name == IDENTIFIER:
        return Parameter(name, about, "0" if not default else f"0x{default:03X}", f"0x{low:X} to 0x{high:X}")
    unit = f" {plain['unit']}" if plain["unit"] else ""
    return Parameter(name, about, _number(default), f"{_number(low)} to {_number(high)}{unit}")


def _number(value: float | str | None) -> str:
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _value(text: str) -> ParameterValue:
    """A number if it is one; otherwise text, which is either a choice or refused by the bench."""
    try:
        return int(text, 16 if text.lower().startswith("0x") else 10)
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        return text


def _free_name(wanted: str, taken: Collection[str]) -> str:
    names: Sequence[str] = [wanted, *(f"{wanted} #{number}" for number in range(2, len(taken) + 3))]
    return next(name for name in names if name not in taken)
