"""Fault injection: what can break at which tap of the signal path, when it does, and how that reaches the bench.

The names here are what a fault of your own needs: a base class, families, kinds of tap, and parameters.
"""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from .catalogue import Entry, catalogue_of, make_fault
    from .declaration import (
        SCALAR_KINDS,
        BusFault,
        ClockFault,
        Context,
        Family,
        Fault,
        JointFault,
        MessageFault,
        NodeFault,
        NodeHandle,
        SignalFault,
        Tap,
        TapKind,
        declared_faults,
    )
    from .engine import FaultEngine
    from .fault_bench import FaultBench
    from .parameters import Parameter, choice, level, of_tap, parameter, parameters_at
    from .taps import taps_of
    from .turns import SetState, SetStatus

__all__ = [
    "SCALAR_KINDS",
    "BusFault",
    "ClockFault",
    "Context",
    "Entry",
    "Family",
    "Fault",
    "FaultBench",
    "FaultEngine",
    "JointFault",
    "MessageFault",
    "NodeFault",
    "NodeHandle",
    "Parameter",
    "SetState",
    "SetStatus",
    "SignalFault",
    "Tap",
    "TapKind",
    "catalogue_of",
    "choice",
    "declared_faults",
    "level",
    "make_fault",
    "of_tap",
    "parameter",
    "parameters_at",
    "taps_of",
]

__getattr__ = loader(
    __name__, __all__, ".declaration", ".parameters", ".catalogue", ".taps", ".fault_bench", ".engine", ".turns"
)
