"""A rig's arguments as the texts of a command line: settings, truth, seed; and the warning about its use.

The controller resolves law and trajectory. Nothing is run here.
"""

import functools
import inspect
import sys
import warnings
import weakref
from collections.abc import Callable, Mapping
from numbers import Integral
from pathlib import Path
from typing import ClassVar, ParamSpec

import numpy as np

from canarm_controller.reference.feedforward import FeedforwardKind
from canarm_emulator.errors import TruthError
from canarm_emulator.robot.truth import truth_keys
from canarm_protocol.cell.cell_messages import nearest
from canarm_protocol.cell.model import Cell
from canarm_protocol.runs.out_folder import OutFolder
from canarm_protocol.shown import quoted

from ..usage import LARGEST_SEED, UsageError, value_text

MECHANICS = (".mass", ".viscous", ".coulomb", ".rotor_inertia", ".wire_stiffness")
"""Endings of the truth's keys that can change during a run."""


class RigWarning(UserWarning):
    """A rig was used in a way that proves nothing."""


class Unused:
    """Whether a rig has been run or finished. One that is discarded without either warns, where it was made.

    The rig's own end would come too late or never: it stands in circles with what it runs.
    """

    waiting: ClassVar[set["Unused"]] = set()
    """Of all rigs that have been neither run nor discarded."""

    def __init__(self, rig: object) -> None:
        self.waiting.add(self)
        frame = sys._getframe(1)
        while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("canarm."):
            frame = frame.f_back
        self._place = (frame.f_code.co_filename, frame.f_lineno)
        self._module = str(frame.f_globals.get("__name__"))
        self._finalizer = weakref.finalize(rig, self._warn)

    def is_used(self) -> None:
        """It has been run, finished, or broken off."""
        self.waiting.discard(self)
        self._finalizer.detach()

    def warn(self) -> None:
        """Warn now, unless it has been used."""
        self._finalizer()

    def _warn(self) -> None:
        self.waiting.discard(self)
        text = "nobody has run this rig: it has tested nothing (rig.run?)"
        warnings.warn_explicit(text, RigWarning, *self._place, module=self._module)


def checked_seed(seed: object) -> int:
    """`seed` as a whole number. Raises `UsageError` if it is none, negative, or above `LARGEST_SEED`."""
    if not isinstance(seed, Integral) or isinstance(seed, bool):
        raise UsageError(f"seed {quoted(seed)}: must be a whole number")
    if int(seed) < 0:
        raise UsageError(f"seed {quoted(seed)}: must not be negative")
    if int(seed) > LARGEST_SEED:
        raise UsageError(f"seed {quoted(seed)}: must be at most {LARGEST_SEED}")
    return int(seed)


def checked_feedforward(given: object) -> str | None:
    """`given` as text, which the controller judges. Raises `UsageError` if it is none."""
    if not isinstance(given, str | None):
        raise UsageError(f"feedforward {quoted(given)}: must be {', '.join(FeedforwardKind)}, or None: the usual one")
    return given


def checked_folder(out: object) -> OutFolder | None:
    """`out` as a folder, which stays where it is now. Raises `UsageError` if it is none."""
    if not isinstance(out, str | Path | None) or "\0" in str(out):
        raise UsageError(f"out {quoted(out)}: must be the path of a folder")
    return None if out is None else OutFolder.at(Path(out))


def checked_switch(what: str, value: object) -> bool:
    """`value` as a bool. Raises `UsageError` if it is neither true nor false."""
    if not isinstance(value, bool | np.bool_) and (not isinstance(value, Integral) or value not in (0, 1)):
        raise UsageError(f"{what} {quoted(value)}: must be True or False")
    return bool(value)


def as_text(what: str, values: Mapping[str, object] | None) -> dict[str, str]:
    """Values as `--set` and `--truth` spell them. Raises `UsageError` for what is no mapping of names."""
    if not isinstance(values, Mapping | None):
        raise UsageError(
            f"{what} {quoted(values)}: must be a mapping of keys and values, such as {{'joint3.mass': 0.9}}"
        )
    for key in values or {}:
        if not isinstance(key, str):
            raise UsageError(f"{what} {quoted(key)}: a key is a name, such as 'joint3.mass'")
    return {key: value_text(value) for key, value in (values or {}).items()}


class UnknownArgument(UsageError, TypeError):
    """No argument has that name."""


P = ParamSpec("P")


def known_arguments(init: Callable[P, None]) -> Callable[P, None]:
    """An `__init__` that answers a misspelled argument with what was probably meant; `UnknownArgument`."""
    names = list(inspect.signature(init).parameters)[1:]

    @functools.wraps(init)
    def checked(*args: P.args, **named: P.kwargs) -> None:
        __tracebackhide__ = True
        for name in named:
            if name not in names:
                made = type(args[0]).__name__
                raise UnknownArgument(f"{made}: no argument {quoted(name)}{nearest(name, names)}")
        init(*args, **named)

    return checked


def check_mechanics(cell: Cell, key: str) -> None:
    """Raises `TruthError` unless `key` can change during a run."""
    if not isinstance(key, str):
        raise TruthError(f"{quoted(key)}: a key is a name, such as 'joint3.mass'")
    known = [each.name for each in truth_keys(cell)]
    if key not in known:
        raise TruthError(f"{key}: no such key{nearest(key, known, 'canarm check --keys')}")
    if not key.endswith(MECHANICS):
        raise TruthError(f"{key}: cannot change during a run; these can: {', '.join(MECHANICS)} of a joint")
