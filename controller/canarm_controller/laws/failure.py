"""Failures inside a law, reported with the line of its file: a law may be the user's own and may fail in any way."""

import sys
import traceback
from collections.abc import Callable
from pathlib import Path

from canarm_protocol.shown import printable

from ..errors import ControllerError, InterruptedRunError, LawError
from .base import ControlLaw

LONGEST_TEXT = 300
"""Longest message from a law's own code, in characters."""


def law_failure(law: type[ControlLaw], method: str, error: BaseException) -> ControllerError:
    """The error to raise for `error`, which `method` of `law` raised. A `ControllerError` is returned as it is.

    Ctrl-C while the law computes is not the law's fault: `InterruptedRunError`.
    """
    text = shown(error, str)
    if isinstance(error, KeyboardInterrupt):
        return InterruptedRunError(f"KeyboardInterrupt in {method}() of law {law.__name__}")
    if type(error).__module__ == ControllerError.__module__ and isinstance(error, ControllerError):
        return type(error)(text)
    text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return LawError(f"law {law.__name__}: {method}() fails{_line(law, error)}: {text}")


def shown(value: object, text_of: Callable[[object], str], width: int = LONGEST_TEXT) -> str:
    """`text_of(value)` on one printable line of at most `width` characters, even if the value's own code fails."""
    try:
        text = text_of(value)
    except BaseException as error:
        return f"(a {type(value).__name__} whose text cannot be had: {type(error).__name__})"
    return printable(" ".join(text.split())[:width])


def _line(law: type[ControlLaw], error: BaseException) -> str:
    """The innermost line of the law's own file, or of any file if the law itself is not to blame."""
    frames = traceback.extract_tb(error.__traceback__)
    file_name = getattr(sys.modules.get(law.__module__), "__file__", None)
    own = [frame for frame in frames if frame.filename == file_name] or frames[-1:]
    return f" at {Path(own[-1].filename).name}, line {own[-1].lineno}" if own else ""
