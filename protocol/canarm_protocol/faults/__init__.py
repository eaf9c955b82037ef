"""Faults as texts and events, and the client that sends them to a running bench."""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from .bench_client import BenchClient
    from .fault_events import FaultEvent
    from .fault_toml import as_toml
    from .script import FaultScript, FaultSet, FaultSpec, Trigger, parse_faults, read_faults

__all__ = [
    "BenchClient",
    "FaultEvent",
    "FaultScript",
    "FaultSet",
    "FaultSpec",
    "Trigger",
    "as_toml",
    "parse_faults",
    "read_faults",
]

__getattr__ = loader(__name__, __all__, ".bench_client", ".script", ".fault_events", ".fault_toml")
