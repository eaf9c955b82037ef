"""Supervision of a run: verdicts from measurements, messages and commands, and the reactions to them."""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from .detection import DETECTORS, Detection, Detector, Reaction
    from .supervisor import Supervisor, Verdict

__all__ = ["DETECTORS", "Detection", "Detector", "Reaction", "Supervisor", "Verdict"]

__getattr__ = loader(__name__, __all__, ".detection", ".supervisor")
