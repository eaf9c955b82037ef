"""What a command does while it is silent for some seconds, and how long it took: for somebody at a terminal only."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def announced(what: str) -> Iterator[None]:
    """A line on stderr that says `what` is being done, and its duration when it is over. Nothing without a terminal."""
    stream = sys.stderr
    if stream is None or not stream.isatty():
        yield
        return
    print(f"canarm: {what} ...", end="", file=stream, flush=True)
    begun_s = time.monotonic()
    try:
        yield
    finally:
        print(f" {time.monotonic() - begun_s:.1f} s", file=stream, flush=True)
