"""What went wrong inside a law, told by the line of its file: a law may be the user's own and may fail in any way."""

import sys
import traceback
from pathlib import Path

from ..errors import ControllerError, LawError
from .base import ControlLaw


def law_failure(law: type[ControlLaw], method: str, error: BaseException) -> ControllerError:
    """What to raise for `error`, which `method` of `law` raised. A `ControllerError` says enough by itself."""
    if isinstance(error, ControllerError):
        return error
    text = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    return LawError(f"law {law.__name__}: {method}() fails{_line(law, error)}: {text}")


def _line(law: type[ControlLaw], error: BaseException) -> str:
    """The innermost line of the law's own file, or of any file where the law itself is not to blame."""
    frames = traceback.extract_tb(error.__traceback__)
    file_name = getattr(sys.modules.get(law.__module__), "__file__", None)
    own = [frame for frame in frames if frame.filename == file_name] or frames[-1:]
    return f" at {Path(own[-1].filename).name}, line {own[-1].lineno}" if own else ""
