"""What can be injected where: the declared faults at the taps of a cell, and the check of one that is asked for."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from canarm_protocol.cell.cell_messages import nearest
from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.script import FaultSpec, ParameterValue, limits_text
from canarm_protocol.shown import named_error, quoted

from .declaration import Fault, Tap, declared_faults
from .parameters import Parameter, parameters_at
from .taps import taps_of


class Entry(NamedTuple):
    """A fault at a tap, with its parameters there."""

    tap: Tap
    fault: type[Fault]
    parameters: tuple[Parameter, ...]


def catalogue_of(cell: Cell) -> list[Entry]:
    """Every fault at every tap of `cell` that supports it, in the order of the signal path."""
    faults = declared_faults()
    return [
        Entry(tap, fault, tuple(parameters_at(fault, tap)))
        for tap in taps_of(cell).values()
        for (_, kind), fault in faults.items()
        if kind is tap.kind
    ]


def as_plain(entries: list[Entry]) -> list[dict[str, Any]]:
    """The catalogue as plain values, for JSON: one object per tap."""
    taps: dict[str, dict[str, Any]] = {}
    for tap, fault, parameters in entries:
        described = taps.setdefault(
            tap.name, {"tap": tap.name, "about": tap.about, "unit": tap.unit, "kind": tap.kind.value, "faults": []}
        )
        described["faults"].append(
            {
                "fault": fault.name,
                "family": fault.family.value,
                "about": about(fault),
                "needs_wire": fault.needs_wire,
                "parameters": [_plain_parameter(each) for each in parameters],
            }
        )
    return list(taps.values())


def about(fault: type[Fault]) -> str:
    """What the fault does, in a sentence: the first line of its docstring."""
    return next(iter((fault.__doc__ or "").strip().splitlines()), fault.name)


class PlannedFault:
    """A fault at a tap as a text asks for it, found and checked. Raises `FaultError`: what would be right.

    `fresh` gives an object for every activation.
    """

    def __init__(self, taps: Mapping[str, Tap], spec: FaultSpec) -> None:
        self.tap, self._type, self._values = _resolve(taps, spec)
        self._first: Fault | None = self._make()

    @property
    def needs_wire(self) -> bool:
        """Whether it acts on the wire model alone."""
        return self._type.needs_wire

    def fresh(self) -> Fault:
        """A fault that has not been active yet. Raises `FaultError`."""
        first, self._first = self._first, None
        return first if first is not None else self._make()

    def _make(self) -> Fault:
        try:
            return self._type(**self._values)
        except Exception as error:
            text = named_error(error)
            raise FaultError(
                f"{self._type.name} at {self.tap.name}: cannot be made: {text} ({self._type.declared_at})"
            ) from None


def make_fault(taps: Mapping[str, Tap], spec: FaultSpec) -> Fault:
    """A fault as `spec` asks for it, for whoever drives it by hand. Raises `FaultError`."""
    return PlannedFault(taps, spec).fresh()


def _resolve(taps: Mapping[str, Tap], spec: FaultSpec) -> tuple[Tap, type[Fault], dict[str, ParameterValue | None]]:
    """The tap, the fault and all its parameters that `spec` asks for."""
    tap = taps.get(spec.tap)
    if tap is None:
        raise FaultError(f"no tap {quoted(spec.tap)}{nearest(spec.tap, taps, '`canarm fault list`')}")
    faults = declared_faults()
    fault = faults.get((spec.fault, tap.kind))
    if fault is None:
        here = [name for name, kind in faults if kind is tap.kind]
        elsewhere = sorted({kind.value for name, kind in faults if name == spec.fault})
        others = f"; acts at: {', '.join(elsewhere)}; supported here are {', '.join(here) or 'none'}"
        hint = others if elsewhere else nearest(spec.fault, here)
        raise FaultError(f"fault {quoted(spec.fault)} is not supported at {tap.name} ({tap.kind.value}){hint}")
    parameters = {each.name: each for each in parameters_at(fault, tap)}
    for name in spec.parameters:
        if name not in parameters:
            raise FaultError(f"{spec.fault} at {tap.name}: no parameter {quoted(name)}{nearest(name, parameters)}")
    values = {
        name: _checked(spec, each, spec.parameters[name]) if name in spec.parameters else each.default
        for name, each in parameters.items()
    }
    return tap, fault, values


def _checked(spec: FaultSpec, parameter: Parameter, value: ParameterValue) -> ParameterValue:
    where = f"{spec.fault} at {spec.tap}: {parameter.name} = {quoted(value)}"
    if parameter.choices:
        if value not in parameter.choices:
            raise FaultError(f"{where}: must be one of {', '.join(parameter.choices)} ({parameter.about})")
        return value
    if isinstance(value, bool | str) or not parameter.minimum <= value <= parameter.maximum:
        bounds = limits_text(parameter.name, parameter.minimum, parameter.maximum, parameter.unit)
        raise FaultError(f"{where}: must be a number from {bounds} ({parameter.about})")
    if parameter.is_whole and value != int(value):
        raise FaultError(f"{where}: must be a whole number ({parameter.about})")
    return int(value) if parameter.is_whole else float(value)


def _plain_parameter(parameter: Parameter) -> dict[str, Any]:
    plain: dict[str, Any] = {"name": parameter.name, "about": parameter.about, "default": parameter.default}
    if parameter.choices:
        return {**plain, "choices": list(parameter.choices)}
    return {**plain, "unit": parameter.unit, "minimum": parameter.minimum, "maximum": parameter.maximum}
