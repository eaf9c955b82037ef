"""Faults as the catalogue makes them, begun outside any bench."""

from collections.abc import Callable
from random import Random

import pytest

from canarm_emulator.faults.catalogue import make_fault
from canarm_emulator.faults.declaration import Context, JointFault, SignalFault
from canarm_emulator.faults.taps import taps_of
from canarm_protocol.cell_file import load_cell
from canarm_protocol.faults import FaultSpec


@pytest.fixture
def begin() -> Callable[..., SignalFault | JointFault]:
    """`begin(tap, fault, now_ns=0, seed=0, **parameters)` gives a fault of konkuk1 that has just begun."""
    taps = taps_of(load_cell("konkuk1"))

    def of(tap: str, name: str, now_ns: int = 0, seed: int = 0, **parameters: float) -> SignalFault | JointFault:
        fault = make_fault(taps, FaultSpec(tap, name, parameters))
        fault.begin(Context(taps[tap], now_ns, 2_500_000, Random(seed)))
        assert isinstance(fault, SignalFault | JointFault)
        return fault

    return of
