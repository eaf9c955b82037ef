"""`canarm monitor`: any CAN bus, decoded, in a terminal or as lines of text."""

import contextlib
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID
from canarm_protocol.canopen.values import whole_number as number_of
from canarm_protocol.decoding import Book, Decoder, bench_book, robot_book
from canarm_protocol.decoding.dbc_files import load_databases
from canarm_protocol.decoding.eds_files import DataSheet
from canarm_protocol.shown import quoted
from canarm_tui.bus.address import BusAddress
from canarm_tui.bus.filtering import FrameFilter
from canarm_tui.bus.plain import after, write_lines
from canarm_tui.bus.watch import BusWatch

from ..number_checks import not_negative
from ..open_cell import open_cell
from ..options import (
    BENCH_BUS,
    DEFAULT_ADDRESS,
    ROBOT_BUS,
    Address,
    BusOptions,
    Flag,
    MoreBusWords,
    NamedBus,
    Seconds,
    Words,
    parse_address,
    whole_number,
)
from ..usage import DEFAULT_CELL, UsageError

OWN = "canarm"
"""The interface of our own buses: a cell is on them."""
Files = Annotated[Words, Parameter(consume_multiple=False, metavar="FILE")]


@Parameter(name="*")
@dataclass(frozen=True)
class KnownOptions:
    """What is known of the bus."""

    cell: Annotated[
        str | None,
        Parameter(
            metavar="NAME|FILE",
            show_default=lambda _: DEFAULT_CELL,
            help="The cell whose cards are on the bus; unless it is given, none on another interface than canarm.",
        ),
    ] = None
    eds: Annotated[
        Files,
        Parameter(
            metavar="[NODE=]FILE",
            help="EDS or DCF file: 0x12=drive.eds is that of a node, drive.eds that of every node that nothing else "
            "describes; may be repeated.",
        ),
    ] = field(default_factory=list)
    dbc: Annotated[Files, Parameter(help="CAN database (DBC); may be repeated.")] = field(default_factory=list)
    bitrate: Annotated[
        int | None,
        Parameter(
            metavar="BIT/S",
            converter=whole_number,
            validator=not_negative,
            show_default=False,
            help="For the load of the bus; else that of the cell, or of the interface's option bitrate.",
        ),
    ] = None

    def book(self, bus: NamedBus) -> tuple[Book, int | None]:
        """What is known of `bus`, and its bit rate. Raises `CellError`, `UsageError`, `ProtocolError`."""
        book, bitrate = Book(), bus.options.get("bitrate")
        name = DEFAULT_CELL if self.cell is None and bus.interface == OWN else self.cell
        if name is not None:
            nominal = open_cell(name, {})
            book = bench_book(nominal) if (bus.interface, bus.channel) == (OWN, BENCH_BUS) else robot_book(nominal)
            bitrate = bitrate or nominal.bus.bitrate
        for text in self.eds:
            _enter_sheet(book, text)
        for text in self.dbc:
            load_databases(book, _path("--dbc", text))
        return book, self.bitrate or (bitrate if isinstance(bitrate, int) else None)


def monitor(
    *bus_options: MoreBusWords,
    connect: Annotated[
        Address, Parameter(help="Where an emulator serves the virtual buses; used unless -i names another bus.")
    ] = DEFAULT_ADDRESS,
    bus: BusOptions = BusOptions(),
    known: KnownOptions = KnownOptions(),
    wanted: Annotated[
        str,
        Parameter(
            name="--filter",
            metavar="WORDS",
            allow_leading_hyphen=True,
            show_default=False,
            help="Only frames that all words fit, such as '200-2ff adc -sync'.",
        ),
    ] = "",
    seconds: Annotated[Seconds | None, Parameter(show_default=False, help="End after this much wall time.")] = None,
    no_tui: Annotated[Flag, Parameter(help="Lines of text, as candump writes them, even on a terminal.")] = False,
) -> int:
    """Watch any CAN bus: frames with rates, decoded as CANopen and by EDS and DBC files; who is there; objects by SDO.

    Nothing is sent unless you read or write an object. Without a terminal each frame is a line of text, as it comes,
    until Ctrl-C or --seconds.
    """
    named = bus.named(bus_options)
    if named is None:
        host, port = parse_address("--connect", connect)
        named = NamedBus(OWN, ROBOT_BUS, {"host": host, "port": port})
    book, bitrate = known.book(named)
    until = after(seconds)
    if no_tui or not all(stream is not None and stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr)):
        return _write_lines(named, book, FrameFilter.parse(wanted), until)
    from canarm_tui.bus.monitor import run_monitor  # the toolkit of the screen takes its time to load

    address = BusAddress(named.interface, named.channel, named.options)
    return run_monitor(BusWatch(book, address.open, address.where, bitrate), until, wanted)


def _write_lines(bus: NamedBus, book: Book, wanted: FrameFilter, until: Callable[[], bool]) -> int:
    """Ctrl-C is how it ends where no time is given, so it is no failure."""
    with bus.open() as port:
        print(f"canarm: listening on {port.description}", file=sys.stderr, flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            write_lines(port, Decoder(book), wanted, sys.stdout, lambda: until() or _nobody_reads())
        counted = port.discarded
    left_out = {"error frames": counted.error_frames, "FD frames": counted.fd_frames, "malformed": counted.malformed}
    for what, count in left_out.items():
        if count:
            print(f"canarm: {count} {what} were left out", file=sys.stderr)
    return 0


def _nobody_reads() -> bool:
    return bool(getattr(sys.stdout, "has_lost_its_reader", False))


def _enter_sheet(book: Book, text: str) -> None:
    """A word of --eds: FILE, or NODE=FILE. Raises `UsageError`, `DictionaryError`."""
    number, equals, name = text.partition("=")
    node_id = number_of(number) if equals else None
    if equals and (node_id is None or not 1 <= node_id <= HIGHEST_NODE_ID):
        raise UsageError(f"--eds {quoted(text)}: write NODE=FILE with a node-ID from 1 to 127, such as 0x12=drive.eds")
    sheet = DataSheet.load(_path("--eds", name if equals else text))
    node_id = node_id or sheet.node_id
    if node_id is not None:
        sheet.enter(book, node_id)
    elif book.describe_others is not None:
        raise UsageError(
            f"--eds {quoted(text)}: a second file for all other nodes; write NODE=FILE, such as 0x12=a.eds"
        )
    else:
        sheet.dictionary(1)
        book.describe_others = sheet.enter


def _path(option: str, text: str) -> Path:
    if not text:
        raise UsageError(f"{option}: the name of the file is empty; name a file, or leave {option} out")
    return Path(text)
