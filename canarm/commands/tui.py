"""`canarm tui`: the dashboard."""

from typing import Annotated

from cyclopts import Parameter

from canarm_tui.app import run_dashboard

from ..options import BENCH_BUS, DEFAULT_ADDRESS, Address, BenchBusOptions, CellOptions, NamedBus, parse_address


def tui(
    *,
    cell: CellOptions = CellOptions(),
    connect: Annotated[
        Address,
        Parameter(help="Where an emulator serves the virtual buses; used unless --bench-interface names another bus."),
    ] = DEFAULT_ADDRESS,
    bus: BenchBusOptions = BenchBusOptions(),
) -> int:
    """Watch a running bench in a dashboard: link, rate, late cycles, joints, error traces, faults.

    A bus that is missing or lost is shown, and tried again. f injects a fault, x clears faults, e is the emergency
    stop, r switches the robot off and on again, q or Ctrl-C quits; bench and controller go on.
    """
    nominal = cell.load()
    host, port = parse_address("--connect", connect)
    named = bus.named() or NamedBus("canarm", BENCH_BUS, {"host": host, "port": port})
    return run_dashboard(nominal, named.interface, named.channel, named.options)
