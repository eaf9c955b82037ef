"""Settings that hold for every test: Hypothesis without deadlines, the same examples in CI, compiled modules kept."""

import contextlib
import gc
import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from itertools import groupby
from pathlib import Path

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


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Spread the dashboard's tests, module by module, evenly among the others.

    They wait for half of their time, and leave a core idle when all workers are at them.
    """
    dashboard = Path(__file__).parent / "tui"
    kinds: tuple[list[list[pytest.Item]], list[list[pytest.Item]]] = [], []
    for path, of_module in groupby(items, lambda item: item.path):
        kinds[path.is_relative_to(dashboard)].append(list(of_module))
    placed: list[tuple[float, list[pytest.Item]]] = []
    for modules in kinds:
        total, before = sum(map(len, modules)), 0
        for module in modules:
            placed.append(((before + len(module) / 2) / total, module))
            before += len(module)
    placed.sort(key=lambda each: each[0])
    items[:] = [item for _, module in placed for item in module]


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
