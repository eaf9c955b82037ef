"""A CAN database as values, and its text in the DBC format. Knows nothing of CANopen or of a cell.

The same values give the same bytes: ASCII, LF line ends, no date.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

NAME_LENGTH = 32
"""Longest name of a node, message or signal in the format."""
ANY_NODE = "Vector__XXX"
"""Stands for a sender or receiver that the database does not name."""
MAX_CYCLE_MS = 3_600_000


@dataclass(frozen=True, slots=True)
class Signal:
    """Bits of a message, least significant byte first: value = raw x factor + offset, in `unit`.

    `minimum` = `maximum` says nothing about the range. `is_float` is an IEEE 754 single in 32 bits.
    """

    name: str
    start_bit: int
    bit_length: int
    is_signed: bool = False
    is_float: bool = False
    factor: float = 1.0
    offset: float = 0.0
    minimum: float = 0.0
    maximum: float = 0.0
    unit: str = ""
    choices: Mapping[int, str] = field(default_factory=dict)
    comment: str = ""


@dataclass(frozen=True, slots=True)
class Message:
    """A frame with an 11-bit identifier. `cycle_ms` is None if it is not cyclic."""

    can_id: int
    name: str
    size: int
    sender: str
    receivers: tuple[str, ...]
    signals: tuple[Signal, ...]
    cycle_ms: float | None = None
    comment: str = ""


@dataclass(frozen=True, slots=True)
class Database:
    """One bus: its nodes with a comment each, and its messages."""

    name: str
    bitrate: int
    nodes: Mapping[str, str]
    messages: tuple[Message, ...]


def dbc_text(database: Database) -> str:
    """The DBC of `database`, messages by identifier."""
    messages = sorted(database.messages, key=lambda message: message.can_id)
    parts = (
        ('VERSION ""', "", "NS_ :", "", "BS_:", "", " ".join(("BU_:", *database.nodes)), ""),
        *(_message_lines(message) for message in messages),
        _comment_lines(database.nodes, messages),
        _attribute_lines(database, messages),
        _choice_lines(messages),
        (
            f"SIG_VALTYPE_ {message.can_id} {signal.name} : 1;"
            for message in messages
            for signal in message.signals
            if signal.is_float
        ),
    )
    return "".join(f"{line}\n" for part in parts for line in part)


def short_names(names: Iterable[str], length: int = NAME_LENGTH) -> dict[str, str]:
    """Each of `names` as an identifier of at most `length` characters, unique among them."""
    given: dict[str, str] = {}
    for name in names:
        identifier = re.sub(r"\W", "_", name, flags=re.ASCII)
        candidate, number = identifier[:length], 1
        while candidate in given.values():
            number += 1
            candidate = f"{identifier[: length - 1 - len(str(number))]}_{number}"
        given[name] = candidate
    return given


def _message_lines(message: Message) -> Iterator[str]:
    yield f"BO_ {message.can_id} {message.name}: {message.size} {message.sender}"
    for signal in message.signals:
        sign = "-" if signal.is_signed or signal.is_float else "+"
        scale = f"({_number(signal.factor)},{_number(signal.offset)})"
        limits = f"[{_number(signal.minimum)}|{_number(signal.maximum)}]"
        receivers = ",".join(message.receivers) or ANY_NODE
        yield (
            f" SG_ {signal.name} : {signal.start_bit}|{signal.bit_length}@1{sign} {scale} {limits} "
            f'"{_ascii(signal.unit)}" {receivers}'
        )
    yield ""


def _comment_lines(nodes: Mapping[str, str], messages: Iterable[Message]) -> Iterator[str]:
    for node, comment in nodes.items():
        if comment:
            yield f'CM_ BU_ {node} "{_ascii(comment)}";'
    for message in messages:
        if message.comment:
            yield f'CM_ BO_ {message.can_id} "{_ascii(message.comment)}";'
        for signal in message.signals:
            if signal.comment:
                yield f'CM_ SG_ {message.can_id} {signal.name} "{_ascii(signal.comment)}";'


def _attribute_lines(database: Database, messages: Iterable[Message]) -> Iterator[str]:
    """GenMsgCycleTime is a FLOAT here: 2.5 ms is no whole number."""
    yield from (
        f'BA_DEF_ BO_ "GenMsgCycleTime" FLOAT 0 {MAX_CYCLE_MS};',
        'BA_DEF_ "BusType" STRING ;',
        'BA_DEF_ "Baudrate" INT 0 1000000;',
        'BA_DEF_ "DBName" STRING ;',
        'BA_DEF_DEF_ "GenMsgCycleTime" 0;',
        'BA_DEF_DEF_ "BusType" "CAN";',
        'BA_DEF_DEF_ "Baudrate" 0;',
        'BA_DEF_DEF_ "DBName" "";',
        'BA_ "BusType" "CAN";',
        f'BA_ "Baudrate" {database.bitrate};',
        f'BA_ "DBName" "{_ascii(database.name)}";',
    )
    for message in messages:
        if message.cycle_ms is not None:
            yield f'BA_ "GenMsgCycleTime" BO_ {message.can_id} {_number(message.cycle_ms)};'


def _choice_lines(messages: Iterable[Message]) -> Iterator[str]:
    for message in messages:
        for signal in message.signals:
            if signal.choices:
                choices = " ".join(f'{value} "{_ascii(text)}"' for value, text in sorted(signal.choices.items()))
                yield f"VAL_ {message.can_id} {signal.name} {choices} ;"


def _number(value: float) -> str:
    return str(int(value)) if float(value).is_integer() else repr(float(value))


def _ascii(text: str) -> str:
    return text.encode("ascii", "replace").decode("ascii").replace('"', "'")
