"""The real stdout, kept for the summary of a run."""

import contextlib
import os
import sys
from collections.abc import Callable


def keep_stdout() -> Callable[[str], None]:
    """Send everything printed from now on to stderr, exit handlers of user code included.

    Returns a function that prints a text and a line end to the real stdout; unread text is dropped, any
    other failure raises `OSError`.
    """
    try:
        fd = sys.stdout.fileno()
    except (AttributeError, OSError, ValueError):  # no stdout at all, or one that is no file
        return lambda text: print(text, flush=True)
    sys.stdout.flush()
    encoding = sys.stdout.encoding
    kept = os.dup(fd)
    os.dup2(os.open(os.devnull, os.O_WRONLY) if sys.stderr is None else 2, fd)

    def say(text: str) -> None:
        data = f"{text}\n".encode(encoding, errors="backslashreplace")
        with contextlib.suppress(BrokenPipeError):
            while data:
                data = data[os.write(kept, data) :]

    return say
