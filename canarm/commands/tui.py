"""`canarm tui`: the dashboard."""

from typing import Annotated

from canarm_protocol.errors import BusError
from canarm_protocol.port import parse_bus_options
from cyclopts import Parameter

from ..options import DEFAULT_ADDRESS, CellOptions, Words, parse_address


def tui(
    *,
    cell: CellOptions = CellOptions(),
    connect: Annotated[
        str, Parameter(help="HOST:PORT of an emulator's virtual bus; used unless --bench-interface names another bus.")
    ] = DEFAULT_ADDRESS,
    bench_interface: Annotated[str | None, Parameter(help="python-can interface of the bench bus.")] = None,
    bench_channel: Annotated[str | None, Parameter(help="Channel of the bench bus.")] = None,
    bench_bus_kwargs: Annotated[Words | None, Parameter(help="KEY=VALUE for the bench bus; may be repeated.")] = None,
) -> int:
    """Watch a running bench: link, rate, late cycles, joints, error traces."""
    from canarm_tui.app import run_dashboard

    nominal = cell.load()
    if bench_interface is not None:
        return run_dashboard(nominal, bench_interface, bench_channel, parse_bus_options(bench_bus_kwargs or []))
    if bench_channel is not None or bench_bus_kwargs:
        raise BusError("--bench-channel and its options need --bench-interface as well")
    host, port = parse_address("--connect", connect)
    return run_dashboard(nominal, "canarm", "bench", {"host": host, "port": port})
