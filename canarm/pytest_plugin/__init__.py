"""The pytest plugin: fixtures `canarm_rig` and `canarm_bench`, their options, and what is kept of a failed test.

pytest loads this module in every run of every project where canarm is installed, so it imports nothing else; what the
fixtures need is imported by the first test that asks for one.
"""

import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from ..rig.arguments import Unused
    from .foreign import CanarmBench
    from .keeping import Keeper
    from .rigs import RigFactory

__all__ = ["FaultWarning", "canarm_bench", "canarm_rig", "class_canarm_rig", "module_canarm_rig"]

_KEEPER: pytest.StashKey["Keeper"] = pytest.StashKey()


class FaultWarning(UserWarning):
    """An injected fault never began, or was itself faulty: the test has not tested what it should."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the fixtures."""
    group = parser.getgroup("canarm", "canarm: robots on an emulated CAN bus")
    group.addoption(
        "--canarm-seed", type=int, default=0, metavar="N", help="Seed of noise and faults of every rig (default 0)."
    )
    group.addoption(
        "--canarm-out",
        type=Path,
        default=None,
        metavar="DIR",
        help="Keep run folder and plot of tests that fail in DIR (default: among pytest's temporary folders).",
    )
    group.addoption(
        "--canarm-bus",
        nargs="?",
        const="virtual",
        default=None,
        metavar="BUS",
        help="Run canarm_rig tests with emulator and controller as processes of their own, over a real bus: "
        "virtual, or socketcan:vcan0,vcan1 (the robot's bus and the bench's). Write =virtual before a path.",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Refuse impossible options before any test runs, and resolve paths against the starting folder."""
    _settle_out(config)
    bus, seed = config.getoption("--canarm-bus"), config.getoption("--canarm-seed")
    if not 0 <= seed < 1 << 63:  # as `LARGEST_SEED` says: nothing is imported before a rig is asked for
        raise pytest.UsageError(f"--canarm-seed {seed}: must be 0 or more, and at most {2**63 - 1}")
    if bus is not None:
        from ..bus_choice import BusChoice
        from ..usage import UsageError

        try:
            BusChoice.parse(bus)
        except UsageError as error:
            raise pytest.UsageError(f"--canarm-bus: {error}; write --canarm-bus=virtual before a path") from None


def _settle_out(config: pytest.Config) -> None:
    """Resolve --canarm-out against the folder in which pytest was started: tests may change the working folder."""
    given: Path | None = config.getoption("--canarm-out")
    if given is None:
        return
    from .place import usable_folder

    out = config.invocation_params.dir / given
    config.option.canarm_out = out
    if not hasattr(config, "workerinput"):  # a worker of pytest-xdist: its parent has checked already
        try:
            usable_folder(out)
        except OSError as error:
            raise pytest.UsageError(f"--canarm-out {given}: {error.strerror}; must be a folder to write in") from None


def _rigs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator["RigFactory"]:
    from .rigs import RigFactory

    keeper = _keeper(request, tmp_path_factory)
    with RigFactory(keeper, request.config) as factory:
        yield factory
    _warn(request, keeper)


@pytest.fixture
def canarm_rig(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator["RigFactory"]:
    """A factory of rigs, called with the arguments of `canarm.Rig`; they are finished after the test."""
    yield from _rigs(request, tmp_path_factory)


@pytest.fixture(scope="class")
def class_canarm_rig(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator["RigFactory"]:
    """As `canarm_rig`, for rigs that all tests of a class share."""
    yield from _rigs(request, tmp_path_factory)


@pytest.fixture(scope="module")
def module_canarm_rig(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator["RigFactory"]:
    """As `canarm_rig`, for rigs that all tests of a file share."""
    yield from _rigs(request, tmp_path_factory)


@pytest.fixture
def canarm_bench(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator["CanarmBench"]:
    """The emulator alone, on its own port, with any program as its controller; see `CanarmBench`."""
    from .foreign import CanarmBench

    keeper = _keeper(request, tmp_path_factory)
    with CanarmBench(keeper.new_folder(), request.config.getoption("--canarm-seed")) as bench:
        keeper.watch(bench)
        yield bench
    _warn(request, keeper)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call() -> Generator[None, object, None]:
    """Warn, in the right test, of a `canarm.Rig` that it has made and never run."""
    known = _unused_rigs()
    yield
    for each in _unused_rigs() - known:
        each.warn()


def _unused_rigs() -> "set[Unused]":
    arguments = sys.modules.get("canarm.rig.arguments")
    return set() if arguments is None else set(arguments.Unused.waiting)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Generator[None, "_Outcome", None]:
    """Report where the runs of a failed test are kept, including those shared with other tests."""
    outcome = yield
    if call.when == "teardown":
        return
    for node in item.listchain():
        keeper = node.stash.get(_KEEPER, None)
        if keeper is not None:
            report = outcome.get_result()
            if report.failed:
                report.sections += keeper.keep() if node is item else keeper.keep_later()


def _keeper(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> "Keeper":
    """The keeper of a test's runs; one per test, cleared after the fixtures that use it."""
    from .keeping import Keeper, file_name

    stash, name = request.node.stash, request.node.name
    if _KEEPER not in stash:
        keeper = Keeper(name, tmp_path_factory.mktemp(file_name(name)), request.config.getoption("--canarm-out"))
        stash[_KEEPER] = keeper
        request.addfinalizer(keeper.clear)
    found: Keeper = stash[_KEEPER]
    return found


def _warn(request: pytest.FixtureRequest, keeper: "Keeper") -> None:
    """Warn of what makes the test prove less than it seems to."""
    for text in keeper.complaints():
        request.node.warn(FaultWarning(text))


if TYPE_CHECKING:
    from typing import Protocol

    class _Outcome(Protocol):
        def get_result(self) -> pytest.TestReport: ...
