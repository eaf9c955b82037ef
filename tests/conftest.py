"""Settings that hold for every test: Hypothesis without deadlines, the same examples in CI, compiled modules kept."""

import contextlib
import gc
import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager

import pytest
from hypothesis import settings

from tests.starter import CAN_FORK, Starter

# A shell that starts the tests in the background has SIGINT ignored, nohup SIGHUP; every process that they start would
# inherit it.
for ignored, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(ignored) is signal.SIG_IGN:
        with contextlib.suppress(ValueError):  # not in the main thread
            signal.signal(ignored, handler)

# Nothing that is collected is garbage.
gc.disable()

# The tests start hundreds of processes. With this set, each would compile all that it imports: twice the time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

settings.register_profile("canarm", deadline=None, derandomize="CI" in os.environ, print_blob=True)
settings.load_profile("canarm")


def pytest_collection_finish() -> None:
    """Thousands of tests are no garbage: to look through them again and again takes a sixth of the time of all."""
    gc.freeze()
    gc.enable()


@contextlib.contextmanager
def _full_at(size: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def full_at() -> Callable[[int], AbstractContextManager[None]]:
    """A disk on which no file grows beyond a number of bytes: a write is cut, as on any full disk."""
    return _full_at


@pytest.fixture(scope="session")
def starter() -> Iterator[Starter | None]:
    """What makes processes of `canarm …` in little time, where it can be had."""
    starter = Starter() if CAN_FORK else None
    yield starter
    if starter is not None:
        starter.close()
