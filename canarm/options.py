"""The options that several commands share, and what they become."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from canarm_protocol.cell import Cell
from canarm_protocol.cell_file import load_cell
from canarm_protocol.port import BusPort, open_port, parse_bus_options
from canarm_protocol.socketcand import DEFAULT_PORT
from cyclopts import Parameter

from .session import DEFAULT_CELL, DEFAULT_LAW, DEFAULT_TRAJECTORY, UsageError, parse_settings

DEFAULT_HOST = "127.0.0.1"
DEFAULT_ADDRESS = f"{DEFAULT_HOST}:{DEFAULT_PORT}"
ClockName = Literal["wall", "sync"]
Words = Annotated[list[str], Parameter(negative=(), consume_multiple=False)]


@Parameter(name="*")
@dataclass(frozen=True)
class CellOptions:
    """Which cell, and which of its gains are other than in the file."""

    cell: Annotated[str, Parameter(help="Cell: a shipped name or a TOML file.")] = DEFAULT_CELL
    settings: Annotated[
        Words, Parameter(name="--set", help="KEY=VALUE over control.* and supervision.* of the cell; may be repeated.")
    ] = field(default_factory=list)

    def load(self) -> Cell:
        """The cell. Raises `CellError` or `UsageError`."""
        return load_cell(self.cell, parse_settings("--set", self.settings))


@Parameter(name="*")
@dataclass(frozen=True)
class ControlOptions:
    """What the controller is to do."""

    law: Annotated[str, Parameter(help="Control law: pd, mras, or FILE.py:CLASS.")] = DEFAULT_LAW
    feedforward: Annotated[
        Literal["none", "table", "online"] | None,
        Parameter(help="Feed-forward torque; the law's own choice unless given."),
    ] = None
    trajectory: Annotated[
        str, Parameter(help="Trajectory: sine, trapezoid, or a CSV file (time_s and a column of degrees a joint).")
    ] = DEFAULT_TRAJECTORY


@Parameter(name="*")
@dataclass(frozen=True)
class OutputOptions:
    """Where the run is recorded and how it is summed up."""

    out: Annotated[Path | None, Parameter(help="Run folder to record into.")] = None
    json: Annotated[bool, Parameter(negative=(), help="Last line on stdout is the summary as one JSON object.")] = False


@Parameter(name="*")
@dataclass(frozen=True)
class BusOptions:
    """The robot's bus and the bench's, by python-can's flags."""

    interface: Annotated[
        str | None, Parameter(name=["--interface", "-i"], help="python-can interface of the robot's bus.")
    ] = None
    channel: Annotated[str | None, Parameter(name=["--channel", "-c"], help="Channel of the robot's bus.")] = None
    bus_kwargs: Annotated[
        Words, Parameter(help="KEY=VALUE for the robot's bus, as host=127.0.0.1; may be repeated.")
    ] = field(default_factory=list)
    bench_interface: Annotated[str | None, Parameter(help="python-can interface of the bench bus.")] = None
    bench_channel: Annotated[str | None, Parameter(help="Channel of the bench bus.")] = None
    bench_bus_kwargs: Annotated[Words, Parameter(help="KEY=VALUE for the bench bus; may be repeated.")] = field(
        default_factory=list
    )

    def open_robot(self) -> BusPort | None:
        """The robot's bus if one is named. Raises `BusError`."""
        if self.interface is None:
            if self.channel is not None or self.bus_kwargs:
                raise UsageError("-c/--channel and bus options need -i/--interface as well")
            return None
        return open_port(self.interface, self.channel, **parse_bus_options(self.bus_kwargs))

    def open_bench(self) -> BusPort | None:
        """The bench bus if one is named. Raises `BusError`."""
        if self.bench_interface is None:
            if self.bench_channel is not None or self.bench_bus_kwargs:
                raise UsageError("--bench-channel and its options need --bench-interface as well")
            return None
        return open_port(self.bench_interface, self.bench_channel, **parse_bus_options(self.bench_bus_kwargs))


def parse_address(option: str, text: str) -> tuple[str, int]:
    """HOST:PORT. Raises `UsageError`."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdigit() or int(port) > 0xFFFF:
        raise UsageError(f"{option} {text}: write HOST:PORT with a port from 0 to 65535, such as {DEFAULT_ADDRESS}")
    return host.strip("[]"), int(port)
