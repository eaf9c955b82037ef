"""canarm: a hardware-in-the-loop bench for robot servo controllers on a virtual CAN bus."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .rig.rig import Rig

    __version__: str

__all__ = ["Rig", "__version__"]


def __getattr__(name: str) -> Any:
    """Load the rig, and the physics engine behind it, only when it is asked for: the command line need not wait for
    it.
    """
    if name == "Rig":
        from .rig.rig import Rig

        return Rig
    if name == "__version__":
        from importlib.metadata import version

        return version("canarm")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """What there is to be had, what is loaded only when it is asked for included."""
    return sorted({*globals(), *__all__})
