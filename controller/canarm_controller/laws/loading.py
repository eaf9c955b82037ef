"""Finding a control law by its name or in a user's file. The laws themselves must not enter beyond the registry."""

import importlib.util
import inspect
import sys
import traceback
from pathlib import Path
from types import ModuleType
from typing import get_args, get_type_hints

from ..errors import LawError
from .base import ControlLaw
from .computed_torque import ComputedTorque
from .mras import Mras
from .mras_lyapunov import MrasLyapunov
from .pd import Pd
from .slotine_li import SlotineLi

LAWS: dict[str, type[ControlLaw]] = {law.name: law for law in (Pd, ComputedTorque, Mras, MrasLyapunov, SlotineLi)}
"""The laws that ship, by the name used on the command line."""


def load_law(spec: str) -> type[ControlLaw]:
    """The law that the command line names: "pd", "mras", or "path/to/file.py:ClassName".

    A file is executed. Raises `LawError`: no such law or file, the file fails (with its line), no such class in it, or
    the class is not a complete law (with what is missing).
    """
    if spec in LAWS:
        return LAWS[spec]
    file_name, colon, class_name = spec.rpartition(":")
    if not colon or not file_name.endswith(".py") or not class_name:
        raise LawError(f"law {spec!r}: no such law; must be one of {', '.join(LAWS)}, or path/to/file.py:ClassName")
    path = Path(file_name)
    if not path.is_file():
        raise LawError(f"law {spec!r}: no file {file_name}; must be an existing Python file")
    module = _run(path)
    found = getattr(module, class_name, None)
    if not inspect.isclass(found):
        own = [
            name for name, item in vars(module).items() if inspect.isclass(item) and item.__module__ == module.__name__
        ]
        raise LawError(f"law {spec!r}: {file_name} has no class {class_name}; its classes: {', '.join(own) or 'none'}")
    if not issubclass(found, ControlLaw):
        raise LawError(f"law {spec!r}: {class_name} is not a law; derive it from canarm_controller.laws.ControlLaw")
    if missing := _missing(found):
        raise LawError(f"law {spec!r}: {class_name} is not a complete law; missing or wrong: {', '.join(missing)}")
    return found


def _run(path: Path) -> ModuleType:
    """Execute the file as a module of its own; dataclasses in it look themselves up in `sys.modules`."""
    module_spec = importlib.util.spec_from_file_location(f"canarm_law_{path.stem}", path)
    if module_spec is None or module_spec.loader is None:
        raise LawError(f"law file {path}: cannot be loaded as Python")
    module = importlib.util.module_from_spec(module_spec)
    sys.modules[module_spec.name] = module
    try:
        module_spec.loader.exec_module(module)
    except SyntaxError as error:
        raise LawError(f"law file {error.filename}, line {error.lineno}: {error.msg}") from error
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if Path(frame.filename) == path.absolute()]
        where = f", line {lines[-1]}" if lines else ""
        raise LawError(f"law file {path}{where}: {type(error).__name__}: {error}") from error
    return module


def _missing(law: type[ControlLaw]) -> list[str]:
    problems = [f"{name}()" for name in sorted(law.__abstractmethods__)]
    if not isinstance(getattr(law, "name", None), str):
        problems.append("name (a text)")
    kinds = get_args(get_args(get_type_hints(ControlLaw)["default_feedforward"])[0])
    if law.default_feedforward not in kinds:
        problems.append(f"default_feedforward (one of {', '.join(kinds)})")
    return problems
