"""A run of the controller: its states, its loop, its records, and the runner that owns clock and sockets."""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from .controller import Controller
    from .loop import ControlLoop
    from .runner import Runner, RunResult
    from .state import State

__all__ = ["ControlLoop", "Controller", "RunResult", "Runner", "State"]

__getattr__ = loader(__name__, __all__, ".controller", ".loop", ".state", ".runner")
