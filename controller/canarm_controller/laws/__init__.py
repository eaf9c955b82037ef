"""Control laws: the interface, the laws that ship, and how to load one."""

from .base import ControlLaw, Cycle
from .loading import LAWS, load_law
from .mras import Mras
from .pd import Pd

__all__ = ["LAWS", "ControlLaw", "Cycle", "Mras", "Pd", "load_law"]
