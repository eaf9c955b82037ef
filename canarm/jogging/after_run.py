"""The robot's bus of a run, for driving its cards by hand once the run is over. Its record ends before that."""

from collections.abc import Callable

from canarm_protocol.cell.model import Cell
from canarm_protocol.faults.bench_client import BenchClient
from canarm_protocol.transport.port import BusPort

from .cards import JogError

LIMIT_S = 3.0
"""Time limit for the bench's answer."""
GOES_ON = "the run goes on, and its controller has the cards; when it is over they can be driven by hand"


def port_after_run(
    cell: Cell, is_over: Callable[[], bool], open_robot: Callable[[], BusPort], open_bench: Callable[[], BusPort]
) -> Callable[[], BusPort]:
    """How to open the robot's bus once `is_over()`; what is done by hand is not to stand in the record of the run.

    The function that is returned raises `JogError` before the end, and `BusError` or `FaultError` where the bench does
    not answer.
    """

    def opened() -> BusPort:
        if not is_over():
            raise JogError(GOES_ON)
        with open_bench() as port, BenchClient(port, cell, LIMIT_S) as client:
            client.record(False)
        return open_robot()

    return opened
