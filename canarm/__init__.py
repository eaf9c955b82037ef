"""canarm: a hardware-in-the-loop bench for robot servo controllers on a virtual CAN bus."""

from typing import TYPE_CHECKING, Any

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from canarm_controller.run.state import State
    from canarm_protocol.faults.bench_client import BenchClient

    from .rig.bus_rig import BusRig
    from .rig.rig import Rig
    from .runs.run import Run, open_run

    __version__: str

__all__ = ["BenchClient", "BusRig", "Rig", "Run", "State", "__version__", "open_run"]

SCAFFOLDING = ("__annotations__", "__builtins__", "__dir__", "__getattr__")
"""Names of every module that tell nobody anything."""
_load = loader(
    __name__,
    __all__,
    "canarm_controller.run.state",
    "canarm_protocol.faults.bench_client",
    ".rig.bus_rig",
    ".rig.rig",
    ".runs.run",
)


def __getattr__(name: str) -> Any:
    """Load the rig, and the physics engine behind it, only when it is asked for: the command line need not wait for
    it.
    """
    if name == "__version__":
        from importlib.metadata import version

        return version("canarm")
    return _load(name)


def __dir__() -> list[str]:
    """What there is to be had, and what every package has; not what it takes to load that."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__") and name not in SCAFFOLDING)})
