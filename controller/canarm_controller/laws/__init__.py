"""Control laws: the interface, the built-in laws, and how to load one."""

from .base import ControlLaw, Cycle
from .computed_torque import ComputedTorque
from .loading import LAWS, load_law
from .mras import Mras
from .mras_lyapunov import MrasLyapunov
from .pd import Pd
from .slotine_li import SlotineLi

__all__ = [
    "LAWS",
    "ComputedTorque",
    "ControlLaw",
    "Cycle",
    "Mras",
    "MrasLyapunov",
    "Pd",
    "SlotineLi",
    "load_law",
]
