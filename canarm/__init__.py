"""canarm: a hardware-in-the-loop bench for robot servo controllers on a virtual CAN bus."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .rig.rig import Rig

__all__ = ["Rig"]


def __getattr__(name: str) -> Any:
    """Load the rig, and the physics engine behind it, only when it is asked for: the command line need not wait for
    it.
    """
    if name == "Rig":
        from .rig.rig import Rig

        return Rig
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
