"""What a fault is: a name, its parameters, the kinds of tap where it may act, and what it does there.

A fault is a dataclass derived from one of the bases below; deriving with `name=...` declares it, in any module. Its
fields are its parameters, made by `parameters.py`. `engine.py` decides when faults act; `modules.py` finds the modules.
"""

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from random import Random
from types import FrameType
from typing import TYPE_CHECKING, ClassVar

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.model import Command
from canarm_protocol.errors import FaultError
from canarm_protocol.shown import quoted

from ..robot.truth import JointTruth
from .modules import import_declared, is_built_in, load_built_in

if TYPE_CHECKING:
    from ..robot.world import World
    from ..wire.wire import Wire


class TapKind(Enum):
    """What flows at a tap; it decides which faults can act there."""

    DAC_CODE = "code of a DAC"
    LATCH = "direction bits"
    OPAMP = "voltage of the op-amp"
    CURRENT = "current command of the amplifier"
    SUPPLY = "supply of the amplifier"
    MOTOR = "motor and its leads"
    BRAKE = "brake"
    LINK = "link of the arm"
    DRIVE_WIRE = "drive wire"
    GRIP = "hand that holds the object"
    SENSOR = "voltage of a sensor"
    ADC_CODE = "code of an ADC channel"
    MESSAGES = "messages on the bus"
    BUS = "the bus as a wire"
    NODE = "a node"
    CLOCK = "time base of the bench"


class Family(Enum):
    """Where a fault belongs."""

    SIGNAL = "signal"
    CONVERTER = "converter"
    WIRING = "wiring"
    ACTUATOR = "actuator"
    MECHANICS = "mechanics"
    MESSAGE = "message"
    BUS = "bus"
    NODE = "node"
    CLOCK = "clock"


SCALAR_KINDS = frozenset({TapKind.DAC_CODE, TapKind.OPAMP, TapKind.CURRENT, TapKind.SENSOR, TapKind.ADC_CODE})
"""Taps that a number flows through."""


@dataclass(frozen=True, slots=True)
class Tap:
    """A named point of the signal path. A scalar is in `low` to `high`, in `unit`, with the resolution `step`.

    `joint` is an index into `Cell.joints`; `node_id` and `channel` (from 1) belong to a card.
    """

    name: str
    kind: TapKind
    about: str
    unit: str = ""
    low: float = 0.0
    high: float = 1.0
    step: float = 0.0
    joint: int = -1
    node_id: int = 0
    channel: int = 0

    @property
    def is_of_a_hand(self) -> bool:
        """Whether faults there may open a hand that holds the object."""
        return self.kind is TapKind.GRIP or self.name.endswith(f".{Command.GRIP}")


@dataclass(frozen=True, slots=True)
class Context:
    """What a fault is told when it begins: tap, time, a random generator of its own, and its set."""

    tap: Tap
    now_ns: int
    cycle_ns: int
    random: Random
    set_name: str = ""


class Fault(ABC):
    """Base of all faults. Deriving with a `name` declares one:

    ```python
    @dataclass
    class Offset(SignalFault, name="offset", family=Family.SIGNAL, acts_on=SCALAR_KINDS):
        '''A constant is added.'''

        value: float = of_tap("what is added", 0.1, -1.0, 1.0)

        def apply(self, value: float, now_ns: int) -> float:
            return value + self.value
    ```
    """

    name: ClassVar[str]
    family: ClassVar[Family]
    acts_on: ClassVar[frozenset[TapKind]]
    needs_wire: ClassVar[bool]
    """Whether it acts on the wire model alone, and is refused without."""
    is_dangerous: ClassVar[bool]
    """Whether it makes torque that nobody asked for, reverses its direction, or breaks the wire."""

    declared_at: ClassVar[str]
    """File and line of the declaration."""
    able_at: ClassVar[frozenset[TapKind]] = frozenset()
    """The kinds of tap where the base can act at all."""

    def __init_subclass__(
        cls,
        name: str = "",
        family: Family = Family.SIGNAL,
        acts_on: Iterable[TapKind] = (),
        needs_wire: bool = False,
        is_dangerous: bool = False,
    ) -> None:
        """Raises `FaultError` for a name that is taken at a kind of tap, and for a kind where the base cannot act."""
        if name:
            if not is_built_in(cls.__module__):
                load_built_in()
            cls.name, cls.family, cls.acts_on = name, family, frozenset(acts_on)
            cls.needs_wire, cls.is_dangerous = needs_wire, is_dangerous
            cls.declared_at = _place_of(cls)
            _check_place(cls)
            _DECLARED.update({(name, kind): cls for kind in cls.acts_on})

    def begin(self, context: Context) -> None:  # noqa: B027
        """It becomes active. Called at every activation, on a fresh object."""


_DECLARED: dict[tuple[str, TapKind], type[Fault]] = {}


def _place_of(fault: type[Fault]) -> str:
    """File and line of the class statement that runs just now."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and (
        frame.f_globals.get("__name__") != fault.__module__ or frame.f_code.co_name == "__init_subclass__"
    ):
        frame = frame.f_back
    return fault.__module__ if frame is None else f"{frame.f_code.co_filename}:{frame.f_lineno}"


def _check_place(fault: type[Fault]) -> None:
    where = f"{fault.declared_at}: fault {quoted(fault.name)}"
    if not fault.acts_on:
        raise FaultError(f"{where}: acts_on is empty; must be kinds of tap, such as SCALAR_KINDS")
    beyond = [kind.name for kind in TapKind if kind in fault.acts_on - fault.able_at]
    if beyond:
        able = ", ".join(kind.name for kind in TapKind if kind in fault.able_at)
        raise FaultError(f"{where}: acts_on has {', '.join(beyond)}; with its base it can act on {able}")
    for kind in TapKind:
        other = _DECLARED.get((fault.name, kind)) if kind in fault.acts_on else None
        # The same lines again mean that a module is imported again, or under another name.
        if other is not None and other.declared_at != fault.declared_at:
            raise FaultError(
                f"{where}: the name is taken at {kind.name} ({kind.value}) by {other.declared_at}; choose another name"
            )


class SignalFault(Fault):
    """Changes the number at a scalar tap, or the two bits of a latch tap."""

    able_at = SCALAR_KINDS | {TapKind.LATCH}

    @abstractmethod
    def apply(self, value: float, now_ns: int) -> float:
        """The value that replaces `value`; the tap limits it to its range, and rounds codes.

        Called whenever the value is passed on, at least once per cycle, with times that never decrease.
        """


class JointFault(Fault):
    """Changes the truth of a joint: its mechanics, motor, brake or supply."""

    able_at = frozenset({TapKind.SUPPLY, TapKind.MOTOR, TapKind.BRAKE, TapKind.LINK, TapKind.DRIVE_WIRE})

    varies: ClassVar[bool] = False
    """Whether `change` is called every cycle; otherwise only when a fault of the arm begins or ends."""

    @abstractmethod
    def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
        """The joint as it now is; `joint` is what earlier faults have left of it."""

    def strike(self, world: "World", joint: int) -> None:
        """Something that happens once, after the truth has changed."""


class GripFault(Fault):
    """Happens to a hand that holds an object, once."""

    able_at = frozenset({TapKind.GRIP})

    @abstractmethod
    def strike(self, world: "World", hand: str) -> None:
        """What happens; `hand` is "master" or "slave"."""


class MessageFault(Fault):
    """Changes which frames go on in one direction of the robot's bus, and when. SYNC and TIME never come here."""

    able_at = frozenset({TapKind.MESSAGES})

    @abstractmethod
    def pass_on(self, frame: Frame, now_ns: int) -> Iterable[tuple[int, Frame]]:
        """What becomes of a frame: (time, frame) pairs at `now_ns` or later, none if it is lost.

        In lockstep, while no run is on, later frames go on at `now_ns` too: time stands still.
        """

    def due(self, until_ns: int) -> Iterable[tuple[int, Frame]]:
        """Frames that it sends by itself before `until_ns`; called once per cycle."""
        return ()

    def rest(self, now_ns: int) -> Iterable[tuple[int, Frame]]:
        """The frames that it still holds back when it ends."""
        return ()


class BusFault(Fault, needs_wire=True):
    """Acts on the wire model."""

    able_at = frozenset({TapKind.BUS})

    @abstractmethod
    def act(self, wire: "Wire", now_ns: int) -> None:
        """Called when it begins and then once a cycle."""

    def end(self, wire: "Wire") -> None:
        """It is over."""


class NodeFault(Fault):
    """Changes how a node behaves, through its `NodeHandle`."""

    able_at = frozenset({TapKind.NODE})

    @abstractmethod
    def act(self, node: "NodeHandle", now_ns: int) -> None:
        """Called when it begins and then once a cycle."""

    @abstractmethod
    def end(self, node: "NodeHandle", now_ns: int) -> None:
        """It is over."""


class NodeHandle(ABC):
    """What a fault can do to a node; the bench supplies it."""

    @abstractmethod
    def set_alive(self, is_alive: bool) -> None:
        """A dead node neither receives, nor sends, nor runs its timers; its outputs stay as they are."""

    @abstractmethod
    def lose_power(self) -> None:
        """Outputs take what the hardware has without power: no current, bridges off."""

    @abstractmethod
    def boot(self, now_ns: int) -> None:
        """Power on or reset: everything as at the start, with a boot-up message."""

    @abstractmethod
    def resume(self, now_ns: int) -> None:
        """Go on after a time in which nothing ran: timers that fell due meanwhile start again."""

    @abstractmethod
    def command(self, state: str, now_ns: int) -> None:
        """Enter an NMT state without a command: "stopped", "pre-operational" or "operational"."""

    @abstractmethod
    def set_deaf(self, is_deaf: bool) -> None:
        """A deaf node receives nothing, SYNC included; its timers run."""

    @abstractmethod
    def set_sync_filter(self, passes: Callable[[int], bool] | None) -> None:
        """`passes(now_ns)` says for each SYNC whether the node sees it; None for all."""

    @abstractmethod
    def set_send_filter(self, passes: Callable[[Frame], Frame | None] | None) -> None:
        """`passes(frame)` returns the frame that goes out for each one sent, or None; without a filter all go out."""

    @abstractmethod
    def set_sdo_refusal(self, is_refusing: bool) -> None:
        """Whether every SDO request is answered by an abort, "general error", and nothing is read or written."""

    @abstractmethod
    def set_timer_scale(self, scale: float) -> None:
        """How long the node's periods last, as multiples of what they should."""

    @abstractmethod
    def add_double(self, now_ns: int) -> None:
        """Another card with the same node-ID, wired to nothing, boots on the bus."""

    @abstractmethod
    def remove_double(self) -> None:
        """It is taken away again."""


class ClockFault(Fault):
    """Changes how long a cycle of the bench lasts in lockstep, or how its clock runs."""

    able_at = frozenset({TapKind.CLOCK})

    @abstractmethod
    def period_ns(self, nominal_ns: int, now_ns: int) -> int:
        """Virtual time from this SYNC to the next one."""


def declared_faults() -> Mapping[tuple[str, TapKind], type[Fault]]:
    """Every declared fault by name and kind of tap. A name may stand for different faults at different kinds of tap.

    Raises `FaultError` if an installed module of faults cannot be imported.
    """
    import_declared()
    return _DECLARED
