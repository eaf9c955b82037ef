"""Where programs find `BenchClient`: faults and the emergency stop of a running bench. It is the protocol's own."""

from canarm_protocol.faults.bench_client import BenchClient

__all__ = ["BenchClient"]
