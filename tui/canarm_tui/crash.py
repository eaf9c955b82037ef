"""What is left after an application has broken: the terminal as it was, the traceback in a file, an error of one line.

Nothing is known here of why it broke.
"""

import contextlib
import logging
import sys
import tempfile
import traceback
from collections.abc import Iterator

from canarm_protocol.shown import named_error

from .errors import BrokenError

_OFF = 1000, 1002, 1003, 1006, 1015, 1016, 1004, 2004
NORMAL_SCREEN = "".join(f"\x1b[?{mode}l" for mode in _OFF) + "\x1b[<u\x1b[?1049l\x1b[?25h"
"""No mouse, no reports of focus, plain pasting and keys (kitty's protocol off), the first screen, a cursor: xterm's
control sequences, as far as textual switches them on.
"""


@contextlib.contextmanager
def terminal_as_before() -> Iterator[None]:
    """After an error in this block stdin's terminal has its modes again, and what was typed is dropped."""
    try:
        import termios

        number = sys.__stdin__.fileno() if sys.__stdin__ is not None else -1
        before = termios.tcgetattr(number)
    except (ImportError, OSError, ValueError, termios.error):
        yield  # no terminal, or Windows
        return
    try:
        yield
    except BaseException as error:
        if not isinstance(error, BrokenError) and sys.__stderr__ is not None:  # textual itself did not get so far
            with contextlib.suppress(OSError):
                sys.__stderr__.write(NORMAL_SCREEN)
                sys.__stderr__.flush()
        with contextlib.suppress(termios.error):
            termios.tcsetattr(number, termios.TCSAFLUSH, before)
        raise


def broken(what: str, error: BaseException) -> BrokenError:
    """The error that says that `what` has ended with `error`, and in which file of the folder for temporary ones its
    traceback is.
    """
    logging.getLogger(__name__).debug("", exc_info=error)
    text = "".join(traceback.format_exception(error))
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="canarm-", suffix=".log", delete=False, encoding="utf-8", errors="backslashreplace"
        ) as file:
            file.write(text)
    except OSError as failure:
        where = f"no traceback, {failure.strerror}; CANARM_LOG=debug shows it"
    else:
        where = f"its traceback is in {file.name}"
    return BrokenError(f"{what} broke, which should not happen: {named_error(error)}; {where}")
