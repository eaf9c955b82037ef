"""Finds a control law by its name or in a user's file."""

import contextlib
import difflib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import get_args, get_type_hints

from canarm_protocol.cell.model import Control
from canarm_protocol.shown import name_of, named_error, printable, quoted

from ..cycle import Cycle
from ..dynamics import Arm
from ..errors import LawError
from .base import ControlLaw
from .computed_torque import ComputedTorque
from .mras import Mras
from .mras_lyapunov import MrasLyapunov
from .pd import Pd
from .slotine_li import SlotineLi

LAWS: dict[str, type[ControlLaw]] = {law.name: law for law in (Pd, ComputedTorque, Mras, MrasLyapunov, SlotineLi)}
"""The built-in laws, by their names on the command line."""
_METHODS = ("start", "update", "shift", "internals")


def load_law(spec: object) -> type[ControlLaw]:
    """The law of a name ("pd"), "path/to/file.py:ClassName" or, in Python, a class or a function.

    A function takes the `Cycle` and returns the torques of all joints in N·m, as `ControlLaw.update` does. The class
    need not be named if its file has only one law. The file is executed; it may import files beside it. Raises
    `LawError`: no such law or file, the file fails (with its line), no such class in it, or the class is not a complete
    law (with what is missing).
    """
    if isinstance(spec, str | Path):
        return _named_law(str(spec))
    if inspect.isclass(spec):
        return _complete(spec, f"law {spec.__qualname__}")
    if isinstance(spec, ControlLaw):
        raise LawError(f"law {type(spec).__name__}: is an object already; give its class, which is made with the arm")
    if callable(spec):
        return _law_of(spec)
    raise LawError(f"law: {type(spec).__name__} is no law; must be a name, FILE.py:CLASS, a class or a function")


def law_name(spec: object) -> str:
    """The law's name in summaries."""
    return str(spec) if isinstance(spec, str | Path) else name_of(spec)


def _named_law(spec: str) -> type[ControlLaw]:
    if spec in LAWS:
        return LAWS[spec]
    file_name, colon, class_name = spec.rpartition(":")
    if spec.endswith(".py"):
        file_name, colon, class_name = spec, ":", ""
    if not colon or not file_name.endswith(".py"):
        raise LawError(
            f"law {quoted(spec)}: no such law{_close(spec)}; must be one of {', '.join(LAWS)}, "
            "or path/to/file.py:ClassName"
        )
    if not class_name and not spec.endswith(".py"):
        raise LawError(f"law {quoted(spec)}: names no class; leave the colon out where {file_name} has only one")
    path = Path(file_name)
    if not path.is_file():
        raise LawError(f"law {quoted(spec)}: no file {printable(file_name)}; must be an existing Python file")
    module = _run(path)
    own = {
        name: item
        for name, item in vars(module).items()
        if inspect.isclass(item) and item.__module__ == module.__name__
    }
    if not class_name:
        laws = [item for item in own.values() if issubclass(item, ControlLaw)]
        if len(laws) != 1:
            raise LawError(f"law {quoted(spec)}: which class? {file_name} has {', '.join(own) or 'none'}")
        return _complete(laws[0], f"law {quoted(spec)}")
    found = getattr(module, class_name, None)
    if not inspect.isclass(found):
        raise LawError(
            f"law {quoted(spec)}: {file_name} has no class {class_name}; its classes: {', '.join(own) or 'none'}"
        )
    return _complete(found, f"law {quoted(spec)}")


def _close(spec: str) -> str:
    close = difflib.get_close_matches(spec, LAWS, n=1)
    return f"; did you mean {quoted(close[0])}?" if close else ""


def _complete(found: type, source: str) -> type[ControlLaw]:
    if not issubclass(found, ControlLaw):
        raise LawError(f"{source}: {found.__name__} is not a law; derive it from canarm_controller.laws.ControlLaw")
    if missing := _missing(found):
        raise LawError(f"{source}: {found.__name__} is not a complete law; missing or wrong: {', '.join(missing)}")
    return found


def _law_of(function: Callable[[Cycle], Sequence[float]]) -> type[ControlLaw]:
    """A law that consists of its `update`."""

    class FunctionLaw(ControlLaw):
        name = law_name(function)

        def __init__(self, arm: Arm, control: Control, period_s: float) -> None:
            """A function needs none of these."""

        def start(
            self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
        ) -> None:
            """It has no state."""

        def update(self, cycle: Cycle) -> Sequence[float]:
            return function(cycle)

    FunctionLaw.__name__ = FunctionLaw.__qualname__ = law_name(function)
    return FunctionLaw


def _run(path: Path) -> ModuleType:
    """Execute the file as a module of its own; dataclasses in it look themselves up in `sys.modules`."""
    module_spec = importlib.util.spec_from_file_location(f"canarm_law_{path.stem}", path)
    if module_spec is None or module_spec.loader is None:
        raise LawError(f"law file {path}: cannot be loaded as Python")
    module = importlib.util.module_from_spec(module_spec)
    sys.modules[module_spec.name] = module
    try:
        with _neighbours(path.absolute().parent):
            module_spec.loader.exec_module(module)
    except SyntaxError as error:
        line = "" if error.lineno is None else f", line {error.lineno}"  # a null byte is in none
        raise LawError(f"law file {error.filename or path}{line}: {error.msg}") from error
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if Path(frame.filename) == path.absolute()]
        where = f", line {lines[-1]}" if lines else ""
        raise LawError(f"law file {path}{where}: {named_error(error)}") from error
    return module


_neighbour_folders: list[str] = []
"""The folder of the last law file, as it is in `sys.path`."""


@contextlib.contextmanager
def _neighbours(folder: Path) -> Iterator[None]:
    """Let a law file import files beside it, now and later, in its `update`.

    Its folder comes last in the path, so that it hides nothing that is installed. Modules imported in this way by an
    earlier law file are forgotten: two folders may each have a `gains.py`, and an edited file is read again.
    """
    for earlier in _neighbour_folders:
        if earlier in sys.path:
            sys.path.remove(earlier)
        for name, module in list(sys.modules.items()):
            if not name.startswith("canarm_law_") and _folder_of(module) == earlier:
                del sys.modules[name]
    _neighbour_folders.clear()
    text = str(folder)
    if text not in sys.path:
        sys.path.append(text)
        _neighbour_folders.append(text)
    importlib.invalidate_caches()
    yield


def _folder_of(module: ModuleType | None) -> str | None:
    file = getattr(module, "__file__", None)
    return str(Path(file).absolute().parent) if isinstance(file, str) else None


def _missing(law: type[ControlLaw]) -> list[str]:
    problems = [f"{name}()" for name in sorted(getattr(law, "__abstractmethods__", ()))]  # compiled: none
    problems += [f"{name} (a method)" for name in _METHODS if not callable(getattr(law, name, None))]
    if not isinstance(getattr(law, "name", None), str):
        problems.append("name (a text)")
    kinds = get_args(get_args(get_type_hints(ControlLaw)["default_feedforward"])[0])
    if law.default_feedforward not in kinds:
        problems.append(f"default_feedforward (one of {', '.join(kinds)})")
    return problems
