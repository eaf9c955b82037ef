"""Options shared by several commands, and what they become. Each can also come from the environment."""

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import can
from cyclopts import Parameter, Token

from canarm_protocol.cell.model import Cell
from canarm_protocol.shown import printable
from canarm_protocol.transport.port import BusPort, open_port, parse_bus_options
from canarm_protocol.transport.socketcand import DEFAULT_PORT

from .misplaced import hint
from .number_checks import not_negative, positive, possible_seed
from .open_cell import open_cell
from .usage import DEFAULT_CELL, DEFAULT_LAW, UsageError, parse_settings

DEFAULT_HOST = "127.0.0.1"
DEFAULT_ADDRESS = f"{DEFAULT_HOST}:{DEFAULT_PORT}"
ROBOT_BUS, BENCH_BUS = "can0", "bench"
LOSSY = "udp_multicast"
"""python-can's interface that may lose frames."""
ALLOW_REMOTE = "allow_remote"
"""Our own option of that interface: without it, frames stay on this machine and only its frames are taken."""

SERIAL = "slcan"

LONGEST_PORT = 20
"""More digits cannot be a port."""
LONGEST_S = 1e6
"""Eleven days: nobody means a longer wait, and some systems cannot wait longer."""
SLOWEST_PACE = 0.01
"""The slowest pace: a cycle of 2.5 ms then takes a quarter of a second, too short for anyone to give up on it."""
DEFAULT_SYNC_TIMEOUT_S = 10.0
"""Longer than the delays of a busy machine, a compiler or paging; a process that ends is noticed at once."""


def named_file(type_: object, tokens: Sequence[Token]) -> Path:
    """The given path; an empty one, as from an unset shell variable, is refused, not taken as the working folder."""
    text = tokens[0].value
    if not text:
        raise ValueError("the name of the file is empty.")
    return Path(text)


def _seconds_or_none(type_: object, tokens: Sequence[Token]) -> float:
    """A number of seconds, or `none`, which waits for ever: infinity."""
    text = tokens[0].value
    try:
        value = math.inf if text.lower() == "none" else float(text)
    except ValueError:
        value = math.nan
    if not value > 0.0 or (value > LONGEST_S and text.lower() != "none"):
        raise ValueError(f"must be a number of seconds above 0 and at most {LONGEST_S:g} s, or none.")
    return value


def multiple_or_max(of: str, least: float) -> Callable[[object, Sequence[Token]], float]:
    """A converter to a multiple of `of`, at least `least`, or `max`: infinity."""

    def convert(type_: object, tokens: Sequence[Token]) -> float:
        text = tokens[0].value
        try:
            value = math.inf if text.lower() == "max" else float(text)
        except ValueError:
            value = math.nan
        if not value >= least or (math.isinf(value) and text.lower() != "max"):
            raise ValueError(f"must be a multiple of {of}, {least:g} or more, or max.")
        return value

    return convert


def whole_number(type_: object, tokens: Sequence[Token]) -> int:
    """A whole number in any of Python's notations; 1.5 is refused."""
    try:
        return int(tokens[0].value, 0)
    except ValueError:
        raise ValueError("must be a whole number.") from None


def wait_text(seconds: float) -> str:
    """A time-out as its option spells it."""
    return f"{seconds:g}" if math.isfinite(seconds) else "none"


def pace_text(pace: float) -> str:
    """A pace as `--pace` spells it."""
    return f"{pace:g}" if math.isfinite(pace) else "max"


Flag = Annotated[bool, Parameter(negative=(), show_default=False)]
Wire = Annotated[
    Flag, Parameter(help="Wire model: frames queue, arbitrate and take their time at the cell's bit rate.")
]
Seconds = Annotated[float, Parameter(metavar="SECONDS", validator=positive, show_default=lambda value: f"{value:g} s")]
SyncTimeout = Annotated[
    float,
    Parameter(
        metavar="SECONDS|none",
        converter=_seconds_or_none,
        show_default=lambda value: f"{value:g} s",
        help="Lockstep: wall time after which a silent partner, sender of SYNC or emulator, is taken for lost; none "
        "lets a debugger hold it for as long as it likes.",
    ),
]
Pace = Annotated[
    float,
    Parameter(
        metavar="X|max",
        converter=multiple_or_max("real time", SLOWEST_PACE),
        show_default=pace_text,
        help="Lockstep: virtual time passes at most X times as fast as the wall clock; max does not wait.",
    ),
]
Address = Annotated[str, Parameter(metavar="HOST:PORT")]
Seed = Annotated[int, Parameter(converter=whole_number, validator=possible_seed, help="Seed of the sensor noise.")]
Words = Annotated[list[str], Parameter(negative=(), metavar="KEY=VALUE", show_default=False)]
Settings = Annotated[Words, Parameter(consume_multiple=False)]
"""One KEY=VALUE per option."""
BusWords = Annotated[Words, Parameter(consume_multiple=True)]
"""An option takes all KEY=VALUE words that follow it, as python-can's own tools do."""
MoreBusWords = Annotated[
    str, Parameter(help="Options KEY=VALUE of the robot's bus, as after --bus-kwargs.", show_env_var=False)
]
ClockName = Annotated[
    Literal["wall", "sync"],
    Parameter(help="What drives time: the wall clock, or SYNC (lockstep: as fast as the machine can, and repeatable)."),
]
Truth = Annotated[
    Settings,
    Parameter(
        help="What differs from nominal in the true robot, as joint3.mass=0.9; may be repeated. Keys: check --keys."
    ),
]
FaultFile = Annotated[
    Path | None,
    Parameter(
        name="--faults",
        metavar="FILE",
        converter=named_file,
        help="Fault file (TOML): sets of faults with their triggers. What can be injected where: fault list.",
    ),
]
WithParent = Annotated[bool, Parameter(negative=(), show=False)]


@Parameter(name="*")
@dataclass(frozen=True)
class CellOptions:
    """Which cell, and which of its gains differ from the file."""

    cell: Annotated[str, Parameter(metavar="NAME|FILE", help="Cell: a shipped name or a TOML file.")] = DEFAULT_CELL
    settings: Annotated[
        Settings,
        Parameter(
            name="--set",
            help="Gain or limit of the controller, or what robots carry, other than in the cell, as "
            "control.natural_frequency_rad_s=10 or object.length_m=0.5; may be repeated. Keys: check --keys.",
        ),
    ] = field(default_factory=list)

    def load(self) -> Cell:
        """The cell. Raises `CellError` or `UsageError`."""
        return open_cell(self.cell, parse_settings("--set", self.settings))


@Parameter(name="*")
@dataclass(frozen=True)
class ControlOptions:
    """What the controller does."""

    law: Annotated[
        str,
        Parameter(
            metavar="NAME|FILE.py:CLASS",
            help="Control law: pd, computed-torque, mras, mras-lyapunov, slotine-li, or a class of your own.",
        ),
    ] = DEFAULT_LAW
    feedforward: Annotated[
        Literal["none", "table", "online"] | None,
        Parameter(help="Feed-forward torque; the law's own choice unless given."),
    ] = None
    trajectory: Annotated[
        str | None,
        Parameter(
            metavar="NAME|FILE[:HOW]",
            help="Trajectory: sine (the usual one), trapezoid, excite (made for canarm identify), or a CSV file with "
            "time_s and a column of degrees for each joint; behind it :spline, :monotone or :samples chooses what lies "
            "between its rows. Two robots that carry an object have circle (the usual one), line and arc, or a file of "
            "the tip's way.",
        ),
    ] = None

    def motion(self, cell: Cell) -> str:
        """The trajectory for `cell`."""
        from canarm_controller.reference.trajectory import usual_motion

        return usual_motion(cell) if self.trajectory is None else self.trajectory


@Parameter(name="*")
@dataclass(frozen=True)
class WallClockOptions:
    """What the controller does to be on time."""

    realtime: Annotated[
        Flag, Parameter(help="Ask for a real-time class and locked memory (Linux); says so when that is not permitted.")
    ] = False
    spin: Annotated[
        int,
        Parameter(
            metavar="US",
            converter=whole_number,
            validator=not_negative,
            show_default=lambda value: f"{value} us",
            help="Poll instead of sleep in the last microseconds before each SYNC.",
        ),
    ] = 0

    def check(self, clock: str, cell: Cell) -> None:
        """Refuse options without effect in lockstep, and a spin that would never sleep. Raises `UsageError`."""
        if clock != "wall" and (self.realtime or self.spin):
            given = "--realtime" if self.realtime else f"--spin {self.spin}"
            raise UsageError(f"{given}: lockstep waits for no clock; leave it out, or take --clock wall")
        if self.spin >= cell.bus.cycle_us:
            raise UsageError(f"--spin {self.spin}: must be less than the cycle of {cell.bus.cycle_us} us")


@Parameter(name="*")
@dataclass(frozen=True)
class BusOptions:
    """The robot's bus, in python-can's flags. `more` are further KEY=VALUE words, given without --bus-kwargs."""

    interface: Annotated[
        str | None,
        Parameter(
            name=["--interface", "-i"],
            metavar="NAME",
            help="python-can interface of the robot's bus, such as socketcan.",
        ),
    ] = None
    channel: Annotated[
        str | None,
        Parameter(name=["--channel", "-c"], metavar="NAME", help="Channel of the robot's bus, such as vcan0."),
    ] = None
    bus_kwargs: Annotated[BusWords, Parameter(help="Options of the robot's bus, such as bitrate=1000000.")] = field(
        default_factory=list
    )

    def named(self, more: Sequence[str] = ()) -> "NamedBus | None":
        """The robot's bus if one is named. Raises `UsageError`."""
        alone = [word for word in more if "=" not in word]
        if alone and (meant := hint(alone, ("--cell", "--law", "--trajectory", "--faults"))):
            raise UsageError(f"{printable(alone[0])}: what is that?{meant}")
        return _named("-i", self.interface, self.channel, [*self.bus_kwargs, *more])


@Parameter(name="*")
@dataclass(frozen=True)
class BenchBusOptions:
    """The bench bus, in flags like those of the robot's bus."""

    bench_interface: Annotated[
        str | None, Parameter(metavar="NAME", help="python-can interface of the bench bus, such as socketcan.")
    ] = None
    bench_channel: Annotated[str | None, Parameter(metavar="NAME", help="Channel of the bench bus, such as vcan1.")] = (
        None
    )
    bench_bus_kwargs: Annotated[BusWords, Parameter(help="Options of the bench bus.")] = field(default_factory=list)

    def named(self) -> "NamedBus | None":
        """The bench bus if one is named. Raises `UsageError`."""
        return _named("--bench-interface", self.bench_interface, self.bench_channel, self.bench_bus_kwargs)


@Parameter(name="*")
@dataclass(frozen=True)
class BenchAttachOptions:
    """Where a running bench is found."""

    connect: Annotated[
        Address,
        Parameter(help="Where an emulator serves the virtual buses; used unless -i names another bus."),
    ] = DEFAULT_ADDRESS
    bench_interface: Annotated[
        str | None,
        Parameter(
            name=["--bench-interface", "-i"],
            metavar="NAME",
            help="python-can interface of the bench bus, such as socketcan.",
        ),
    ] = None
    bench_channel: Annotated[
        str | None,
        Parameter(name=["--bench-channel", "-c"], metavar="NAME", help="Channel of the bench bus, such as vcan1."),
    ] = None
    bench_bus_kwargs: Annotated[BusWords, Parameter(help="Options of the bench bus.")] = field(default_factory=list)

    def named(self) -> "NamedBus":
        """The bench bus. Raises `UsageError`."""
        host, port = parse_address("--connect", self.connect)
        named = _named("-i", self.bench_interface, self.bench_channel, self.bench_bus_kwargs)
        return named or NamedBus("canarm", BENCH_BUS, {"host": host, "port": port})


@dataclass(frozen=True)
class NamedBus:
    """A bus in python-can's terms, not yet open."""

    interface: str
    channel: str | None
    options: Mapping[str, Any]

    @property
    def reaches_network(self) -> bool:
        """Whether other machines can send to it."""
        return self.interface == LOSSY and bool(self.options.get(ALLOW_REMOTE))

    def allowing_remote(self) -> "NamedBus":
        """The same bus, open to other machines if its interface has to be told."""
        return replace(self, options={**self.options, ALLOW_REMOTE: True}) if self.interface == LOSSY else self

    def open(self) -> BusPort:
        """Open it. Raises `BusError`."""
        return open_port(self.interface, self.channel, **self.options)


def check_pace(clock: str, pace: float | None) -> None:
    """Refuse a pace on the wall clock. Raises `UsageError`."""
    if clock == "wall" and pace is not None and math.isfinite(pace):
        raise UsageError(f"--pace {pace_text(pace)}: the wall clock has one pace; leave it out, or take --clock sync")


def check_clock(clock: str, *buses: NamedBus | None) -> None:
    """Refuse lockstep over a bus that may lose frames. Raises `UsageError`."""
    if clock == "sync" and any(bus is not None and bus.interface == LOSSY for bus in buses):
        raise UsageError(
            f"--clock sync over {LOSSY}: it may lose frames, and lockstep would stand still; take --clock wall"
        )


def parse_address(option: str, text: str, any_port: bool = False, scheme: str = "") -> tuple[str, int]:
    """HOST:PORT behind `scheme`, with port 0 only where `any_port` says so. Raises `UsageError`."""
    host, colon, digits = text.removeprefix(scheme).rpartition(":")
    lowest = 0 if any_port else 1
    # `isdigit` alone accepts digits of other scripts and superscripts; `int` refuses a few thousand digits.
    is_number = digits.isascii() and digits.isdigit() and len(digits) <= LONGEST_PORT
    if not colon or not host or not is_number or not lowest <= int(digits) <= 0xFFFF:
        raise UsageError(
            f"{option} {printable(text)}: write {scheme}HOST:PORT with a port from {lowest} to 65535, such as "
            f"{scheme}{DEFAULT_ADDRESS}"
        )
    return host.strip("[]"), int(digits)


def _named(option: str, interface: str | None, channel: str | None, words: Sequence[str]) -> NamedBus | None:
    options = parse_bus_options(words)
    if interface is None:
        if channel is not None or words:
            given = printable(f"channel {channel}" if channel is not None else words[0])
            raise UsageError(f"{given}: of which bus? name its interface, such as {option} socketcan")
        return None
    if interface not in can.VALID_INTERFACES:
        known = sorted(can.VALID_INTERFACES)
        close = difflib.get_close_matches(interface, known, n=1)
        hint = f"did you mean {close[0]}?" if close else f"it knows {', '.join(known)}"
        raise UsageError(f"{option} {printable(interface)}: python-can knows no such interface; {hint}")
    if interface == SERIAL and channel is None:
        raise UsageError(f"{option} {interface}: on which serial line? add its channel, such as -c /dev/ttyACM0")
    return NamedBus(interface, channel, options)
