"""The commands of `canarm jog`: from a line of text to a value that says what to do, checked against the cell.

Nothing is driven here. A wrong line raises `UsageError` with one line and has no effect.
"""

import difflib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from canopen.objectdictionary import INTEGER_TYPES

from canarm_protocol.canopen.dictionary import variable_at
from canarm_protocol.canopen.values import ValueTextError, value_bytes, whole_number
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import CardNode, DirectionBits, bridge_directions, command_codec
from canarm_protocol.shown import quoted

from ..usage import UsageError

MOST_STEPS = 100_000
"""Cycles of one `step`: 250 s at 2.5 ms. A longer run needs supervision."""
DIRECTIONS = {
    "ccw": DirectionBits.COUNTER_CLOCKWISE,
    "cw": DirectionBits.CLOCKWISE,
    "off": DirectionBits.OFF,
}
DIRECTION_NAMES = {bits: name for name, bits in DIRECTIONS.items()}


@dataclass(frozen=True, slots=True)
class Drive:
    """Set DAC code and direction of a joint (index in `cell.joints`); None leaves a value unchanged."""

    joint: int
    code: int | None
    direction: DirectionBits | None


@dataclass(frozen=True, slots=True)
class AllOff:
    """Every code 0, every direction off."""


@dataclass(frozen=True, slots=True)
class Step:
    """Run a number of SYNC cycles."""

    cycles: int


@dataclass(frozen=True, slots=True)
class Read:
    """Read all inputs."""


@dataclass(frozen=True, slots=True)
class ShowState:
    """Show cards and outputs."""


@dataclass(frozen=True, slots=True)
class Start:
    """NMT start."""


@dataclass(frozen=True, slots=True)
class Stop:
    """NMT stop."""


@dataclass(frozen=True, slots=True)
class PreOperational:
    """NMT stop, then pre-operational."""


@dataclass(frozen=True, slots=True)
class Reset:
    """NMT reset, identity, configuration."""


@dataclass(frozen=True, slots=True)
class SdoRead:
    """Read an object of a card."""

    node: CardNode
    index: int
    subindex: int


@dataclass(frozen=True, slots=True)
class SdoWrite:
    """Write an object of a card; `value` has the object's length."""

    node: CardNode
    index: int
    subindex: int
    value: bytes


@dataclass(frozen=True, slots=True)
class Help:
    """List the commands."""


@dataclass(frozen=True, slots=True)
class Quit:
    """Leave the cards safe and end."""


Command = (
    Drive | AllOff | Step | Read | ShowState | Start | Stop | PreOperational | Reset | SdoRead | SdoWrite | Help | Quit
)


class Parser:
    """Reads commands for one cell."""

    def __init__(self, cell: Cell, nodes: Sequence[CardNode]) -> None:
        self._cell, self._nodes = cell, nodes
        self._readers: dict[str, Callable[[list[str]], Command]] = {
            "dac": self._dac,
            "current": self._current,
            "dir": self._direction,
            "step": self._step,
            "sdo": self._sdo,
        }

    def parse(self, line: str) -> Command | None:
        """The command of one line, None for an empty line or a comment (#). Raises `UsageError`."""
        words = line.partition("#")[0].split()
        if not words:
            return None
        name, rest = words[0].lower(), words[1:]
        if name not in USAGE:
            close = difflib.get_close_matches(name, USAGE, n=1)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(USAGE)}"
            raise UsageError(f"{name}: no such command; {hint}")
        if name in _PLAIN:
            if rest:
                raise UsageError(f"{name}: takes nothing more; leave out {' '.join(rest)}")
            return _PLAIN[name]()
        return self._readers[name](rest)

    def parse_all(self, text: str) -> list[Command]:
        """The commands between semicolons and line ends. Raises `UsageError` before any could be carried out."""
        commands = (self.parse(part) for line in text.splitlines() for part in line.split(";"))
        return [command for command in commands if command is not None]

    def _dac(self, words: list[str]) -> Command:
        joint, code = self._joint_and_one(words, "dac")
        return Drive(joint, _integer("dac", "CODE", code, 0, self._full_scale(joint)), None)

    def _current(self, words: list[str]) -> Command:
        joint, text = self._joint_and_one(words, "current")
        limit = self._cell.joints[joint].drive.max_current_a
        try:
            current_a = float(text)
        except ValueError:
            current_a = math.nan
        if not abs(current_a) <= limit:
            raise UsageError(
                f"current {text}: must be a number of A from -{limit:g} to {limit:g}, the amplifier's limit"
            )
        code = int(abs(current_a) * self._full_scale(joint) / limit + 0.5)
        if code == 0:
            return Drive(joint, 0, DirectionBits.OFF)
        return Drive(joint, code, bridge_directions(self._cell, joint)[current_a > 0.0])

    def _full_scale(self, joint: int) -> int:
        return command_codec(self._cell, joint).full_scale

    def _direction(self, words: list[str]) -> Command:
        joint, name = self._joint_and_one(words, "dir")
        if name not in DIRECTIONS:
            raise UsageError(f"dir {name}: must be one of {', '.join(DIRECTIONS)}")
        return Drive(joint, None, DIRECTIONS[name])

    def _step(self, words: list[str]) -> Command:
        if len(words) > 1:
            raise _wrong("step")
        return Step(_integer("step", "N", words[0], 1, MOST_STEPS) if words else 1)

    def _sdo(self, words: list[str]) -> Command:
        is_write = words[:1] == ["write"]
        if words[:1] not in (["read"], ["write"]) or not 3 <= len(words) - is_write <= 4:
            raise _wrong("sdo")
        texts = words[3:-1] if is_write else words[3:]
        node = self._node(words[1])
        index = _integer("sdo", "INDEX", words[2], 0, 0xFFFF)
        subindex = _integer("sdo", "SUB", texts[0], 0, 0xFF) if texts else 0
        if is_write:
            return SdoWrite(node, index, subindex, _value(node, index, subindex, words[-1]))
        return SdoRead(node, index, subindex)

    def _joint_and_one(self, words: list[str], command: str) -> tuple[int, str]:
        if len(words) != 2:
            raise _wrong(command)
        names = self._cell.joint_names
        if words[0] not in names:
            raise UsageError(f"{command} {words[0]}: no such joint; there are {', '.join(names)}")
        return names.index(words[0]), words[1]

    def _node(self, text: str) -> CardNode:
        number = whole_number(text)
        for node in self._nodes:
            if text == node.card.name or number == node.card.node_id:
                return node
        known = ", ".join(f"{node.card.name} (0x{node.card.node_id:02X})" for node in self._nodes)
        raise UsageError(f"sdo {text}: no such card; there are {known}")


USAGE = {
    "read": ("read", "all inputs: code and physical value"),
    "scan": ("scan", "the same as read"),
    "dac": ("dac JOINT CODE", "code of the joint's DAC, from 0; the direction stays"),
    "current": ("current JOINT A", "signed current in A: DAC code and direction; positive is towards positive angles"),
    "dir": ("dir JOINT ccw|cw|off", "direction bits of the joint; the code stays"),
    "off": ("off", "every code 0, every direction off"),
    "step": ("step [N]", "N cycles (1): outputs act at SYNC; in lockstep time moves by N cycles"),
    "state": ("state", "cards and outputs, as the cards say"),
    "start": ("start", "NMT start: cards in OPERATIONAL, outputs 0"),
    "stop": ("stop", "NMT stop: outputs take their error values, 0"),
    "preop": ("preop", "cards in PRE-OPERATIONAL, by way of stop"),
    "reset": ("reset", "NMT reset, then identity and configuration; cards in PRE-OPERATIONAL"),
    "sdo": ("sdo read NODE INDEX [SUB], sdo write NODE INDEX [SUB] VALUE", "an object of a card, by name or node-ID"),
    "help": ("help", "this"),
    "quit": ("quit", "outputs off, cards in PRE-OPERATIONAL, end"),
}
"""Command: syntax, effect."""

_PLAIN: dict[str, Callable[[], Command]] = {
    "read": Read,
    "scan": Read,
    "off": AllOff,
    "state": ShowState,
    "start": Start,
    "stop": Stop,
    "preop": PreOperational,
    "reset": Reset,
    "help": Help,
    "quit": Quit,
}


def help_lines() -> list[str]:
    """What `help` shows."""
    lines = [f"{written}\n    {what}" for written, what in USAGE.values()]
    return [*lines, "Outputs act at the next step. Several commands fit on a line, with ; between them."]


def _wrong(command: str) -> UsageError:
    return UsageError(f"{command}: write {USAGE[command][0]}")


def _integer(command: str, what: str, text: str, low: int, high: int) -> int:
    value = whole_number(text)
    if value is None or not low <= value <= high:
        raise UsageError(f"{command} {text}: {what} must be a whole number from {low} to {high} (0x.. is hexadecimal)")
    return value


def _value(node: CardNode, index: int, subindex: int, text: str) -> bytes:
    """The bytes of an integer object. Raises `UsageError` if the EDS has none, or the number does not fit."""
    variable = variable_at(node.dictionary, index, subindex)
    where = f"sdo write 0x{index:04X}:{subindex:02X}"
    if variable is None:
        raise UsageError(f"{where}: the EDS of {node.card.model} has no such object")
    if variable.data_type not in INTEGER_TYPES:
        raise UsageError(f"{where}: {quoted(variable.name)} is no integer; only integers can be written here")
    try:  # beyond the limits in the EDS it is the card that refuses
        return value_bytes(variable, text, is_limited=False)
    except ValueTextError as error:
        raise UsageError(f"{where}: VALUE {error}") from None
