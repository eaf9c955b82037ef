"""The parameters of a fault: how a class declares them. Their bounds are checked where they are declared.

`catalogue.py` checks the values that are asked for.
"""

import dataclasses
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

from canarm_protocol.errors import FaultError
from canarm_protocol.shown import quoted

from .declaration import Fault, Tap


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter at a tap: a number in `unit` from `minimum` to `maximum`, or one of the words `choices`.

    A `default` of None means that the fault finds a value by itself, as `about` says.
    """

    name: str
    about: str
    unit: str
    default: float | str | None
    minimum: float = 0.0
    maximum: float = 0.0
    choices: tuple[str, ...] = ()
    is_whole: bool = False


def parameter(
    about: str,
    unit: str,
    default: float | None,
    minimum: float,
    maximum: float,
    *,
    is_whole: bool = False,
) -> Any:
    """A numeric parameter of a fault; bounds are inclusive. These functions raise `FaultError` for wrong arguments."""
    call = "parameter(about, unit, default, minimum, maximum, *, is_whole=False)"
    _check_arguments(call, {"about": about, "unit": unit}, default, minimum, maximum)
    meta = Parameter("", about, unit, default, minimum, maximum, is_whole=is_whole)
    return field(default=default, metadata={"parameter": meta})


def of_tap(about: str, default: float | None, minimum: float, maximum: float, per: str = "") -> Any:
    """A numeric parameter in the unit of the tap, or `per` something such as "s".

    Bounds and default are multiples of the tap's range, high - low; the fault gets the value in the tap's unit.
    """
    call = 'of_tap(about, default, minimum, maximum, per="")'
    _check_arguments(call, {"about": about, "per": per}, default, minimum, maximum)
    meta = Parameter("", about, per, default, minimum, maximum)
    return field(default=default, metadata={"parameter": meta, "of_tap": True})


def level(about: str, default: float | None) -> Any:
    """A parameter that is a value of the tap, from its low to its high. `default`: 0 is low, 1 is high."""
    _check_arguments("level(about, default)", {"about": about}, default, 0.0, 1.0)
    meta = Parameter("", about, "", default, 0.0, 1.0)
    return field(default=default, metadata={"parameter": meta, "level": True})


def bit_of_code(about: str) -> Any:
    """A parameter that is one bit of the tap's code, 0 the lowest; the default is the middle one."""
    return _of_code("bit_of_code(about)", about, 0, _of_bits)


def code_of_tap(about: str) -> Any:
    """A parameter that is a code of the tap above its lowest; the default is the middle one."""
    return _of_code("code_of_tap(about)", about, 0, _of_codes)


def count_of_codes(about: str) -> Any:
    """A parameter that is a number of codes of the tap; the default is one."""
    return _of_code("count_of_codes(about)", about, 1, _of_counts)


def _of_code(call: str, about: str, default: int, bounds: Callable[[Tap], tuple[str, int, int, int]]) -> Any:
    _check_arguments(call, {"about": about}, None, 0.0, 0.0)
    meta = Parameter("", about, "", None, is_whole=True)
    return field(default=default, metadata={"parameter": meta, "of_code": bounds})


def _of_bits(tap: Tap) -> tuple[str, int, int, int]:
    """Unit, default, least and greatest."""
    bits = round(tap.high - tap.low).bit_length()
    return "", bits // 2, 0, bits - 1


def _of_codes(tap: Tap) -> tuple[str, int, int, int]:
    low, high = round(tap.low), round(tap.high)
    return tap.unit, low + (high - low + 1) // 2, low + 1, high


def _of_counts(tap: Tap) -> tuple[str, int, int, int]:
    return tap.unit, 1, 1, round(tap.high - tap.low)


def choice(about: str, choices: tuple[str, ...]) -> Any:
    """A parameter that is one of some words; the first is the default."""
    given: object = choices
    if not isinstance(given, tuple | list) or not given or not all(isinstance(each, str) for each in given):
        raise _refused("choice(about, choices)", f"choices = {quoted(choices)}: must be words, at least one")
    _check_arguments("choice(about, choices)", {"about": about}, None, 0.0, 0.0)
    meta = Parameter("", about, "", choices[0], choices=tuple(choices))
    return field(default=choices[0], metadata={"parameter": meta})


def _check_arguments(call: str, texts: Mapping[str, object], default: object, minimum: object, maximum: object) -> None:
    for name, value in texts.items():
        if not isinstance(value, str):
            raise _refused(call, f"{name} = {quoted(value)}: must be text")
    for name, value in (("minimum", minimum), ("maximum", maximum), ("default", default)):
        if isinstance(value, bool) or not (isinstance(value, float | int) or (value is None and name == "default")):
            raise _refused(call, f"{name} = {quoted(value)}: must be a number")
    if not minimum <= maximum:  # type: ignore[operator]
        raise _refused(call, f"minimum = {quoted(minimum)} is above maximum = {quoted(maximum)}")
    if default is not None and not minimum <= default <= maximum:  # type: ignore[operator]
        raise _refused(call, f"default = {quoted(default)}: must be from {quoted(minimum)} to {quoted(maximum)}")


def _refused(call: str, problem: str) -> FaultError:
    """The error about a parameter, with the line and the class where it is declared."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__") == __name__:
        frame = frame.f_back
    if frame is None:
        return FaultError(f"{problem}; {call}")
    return FaultError(
        f"{frame.f_code.co_filename}:{frame.f_lineno}: class {frame.f_code.co_name}: {problem}; the call is {call}"
    )


def parameters_at(fault: type[Fault], tap: Tap) -> list[Parameter]:
    """The parameters of `fault` at `tap`, with their bounds in the tap's unit. Raises `FaultError` for no dataclass."""
    if not dataclasses.is_dataclass(fault):
        raise FaultError(f"{fault.declared_at}: class {fault.__name__}: must be a @dataclass")
    found = []
    span = tap.high - tap.low
    for each in dataclasses.fields(fault):
        meta = each.metadata.get("parameter")
        if meta is None:
            continue
        meta = dataclasses.replace(meta, name=each.name)
        zero = tap.low if "level" in each.metadata else 0.0
        if "level" in each.metadata or "of_tap" in each.metadata:
            unit = f"{tap.unit}/{meta.unit}" if meta.unit else tap.unit
            default = None if meta.default is None else zero + span * meta.default
            low, high = zero + span * meta.minimum, zero + span * meta.maximum
            meta = dataclasses.replace(meta, unit=unit, default=default, minimum=low, maximum=high)
        if "of_code" in each.metadata:
            unit, default, low, high = each.metadata["of_code"](tap)
            meta = dataclasses.replace(meta, unit=unit, default=default, minimum=low, maximum=high)
        found.append(meta)
    return found
