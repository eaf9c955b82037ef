"""The schema of a cell: robots, cards, wiring, bus and control gains, as frozen values.

A cell holds *nominal* parameters, known to every program. What differs in the true robot never enters here. Rules about
several values are in `cell_checks.py`; robots are described in `arm.py`, `drives.py` and `sensors`. Units are in the
key names. Angles are in degrees, because people write the file.
"""

import itertools
from collections import Counter
from collections.abc import Mapping
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, Field, SerializeAsAny, ValidatorFunctionWrapHandler, WrapValidator, create_model
from pydantic_core import PydanticCustomError

from ..canopen.frames import HIGHEST_NODE_ID
from ..cards import KINDS, CardKind, Codec, Settings, Wire
from .arm import Body, Joint, Link, Motor, Robot
from .carried import Carried
from .control import Control, JointControl, MrasGains, MrasLyapunovGains, ObserverGains, SlotineLiGains
from .drives import D669, Command, Drive
from .sensors import SENSOR_KINDS, Quantity, Sensor, Sensors
from .table import Finite, Name, NonNegative, Positive, Table, Vector

__all__ = [
    "BITRATES", "CARD_TYPES", "D669", "LONGEST_CYCLE_US", "SENSOR_KINDS", "SHORTEST_CYCLE_US", "Body", "Bus", "Card",
    "Carried", "Cell", "Channel",
    "Command", "Control", "Drive", "Finite", "Joint", "JointControl", "Link", "Motor", "MrasGains", "MrasLyapunovGains",
    "Name", "NodeId", "NonNegative", "ObserverGains", "Physics", "Positive", "Quantity", "Robot", "Sensor", "Sensors",
    "SlotineLiGains", "Supervision", "Table", "Vector", "leaves",
]  # fmt: skip

NodeId = Annotated[int, Field(ge=1, le=HIGHEST_NODE_ID)]
Bitrate = Literal[10_000, 20_000, 50_000, 125_000, 250_000, 500_000, 800_000, 1_000_000]
BITRATES: tuple[int, ...] = get_args(Bitrate)
"""Bit rates of CiA 301, section 5.5, in bit/s."""
SHORTEST_CYCLE_US, LONGEST_CYCLE_US = 500, 100_000

_WIRES: Mapping[str, Wire] = {
    Command.CURRENT: Wire.CURRENT_COMMAND,
    Command.DIRECTION: Wire.DIRECTION,
    Command.GRIP: Wire.DIRECTION,
    **{name: kind.wire for name, kind in SENSOR_KINDS.items()},
}


def leaves(wire: Wire) -> tuple[str, ...]:
    """What can be wired to a card that takes `wire`: drive commands or kinds of sensor."""
    return tuple(leaf for leaf, its_wire in _WIRES.items() if its_wire is wire)


class Bus(Table):
    """The robot's CAN bus."""

    bitrate: Bitrate
    cycle_us: Annotated[int, Field(ge=SHORTEST_CYCLE_US, le=LONGEST_CYCLE_US)]
    heartbeat_ms: Annotated[int, Field(ge=1, le=10_000)]
    heartbeat_timeout_ms: Annotated[int, Field(ge=2, le=60_000)]
    controller_node_id: NodeId
    bench_node_id: NodeId
    compute_delay_us: Annotated[int, Field(ge=0)] = 500
    boot_ms: Annotated[int, Field(ge=0, le=1000)] = 10
    """Time from NMT reset to a card's boot-up message on the wall clock; in lockstep there is no delay."""
    carry_refresh_ms: Annotated[int, Field(ge=1, le=10_000)] | None = None
    """How often the controller writes an error value anew to the cards of robots with `when_lost = "carry"`: what
    carries the present pose, one object each time. Left out: they keep what the cell says."""

    @property
    def cycle_ns(self) -> int:
        """Cycle time, the period of SYNC, in ns."""
        return self.cycle_us * 1000

    @property
    def cycle_s(self) -> float:
        """Cycle time in s."""
        return self.cycle_us * 1e-6


class Physics(Table):
    """How finely the emulator integrates: the longest step bounds the error of the motion."""

    max_step_us: Annotated[int, Field(ge=10, le=2000)]


class Channel(Table):
    """One wire: channel `number` of a card (1-based, as CiA 401 counts) to `signal` = "<joint>.<command or sensor>".

    The joint goes by its name within the card's robot.
    """

    number: Annotated[int, Field(ge=1, le=8)]
    signal: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]*\.[a-z_]+$")]
    error_value: Annotated[int, Field(ge=0)] = 0
    """Output when the controller is lost: a DAC code or direction bits. 0 is no current, or off."""

    @property
    def joint(self) -> str:
        """Name of the joint at the far end of the wire."""
        return self.signal.split(".")[0]

    @property
    def leaf(self) -> str:
        """The far end of the wire: a `Command` of the joint's drive, or the kind of one of its sensors."""
        return self.signal.split(".")[1]


def _known_model(model: str) -> str:
    if model not in KINDS:
        *most, last = map(repr, KINDS)
        raise PydanticCustomError("enum", "no such card", {"expected": f"{', '.join(most)} or {last}"})
    return model


class Card(Settings):
    """A peripheral card in a slot of one robot's Apple II, and a CANopen node.

    The cards of a cell are of the subclasses in `CARD_TYPES`, which have the settings of their kinds as well.
    """

    name: Name
    model: Annotated[str, AfterValidator(_known_model)]
    robot: Name
    slot: Annotated[int, Field(ge=1, le=7)]
    node_id: NodeId
    channel: Annotated[tuple[Channel, ...], Field(min_length=1, max_length=8)]

    @property
    def kind(self) -> CardKind:
        """The descriptor of its model."""
        return KINDS[self.model]

    @property
    def codec(self) -> Codec:
        """How its channels' codes sit in its objects."""
        return self.kind.codec(self)

    @property
    def channel_us(self) -> int:
        """Conversion time per channel, one channel after the other; 0 where all are sampled at SYNC."""
        return self.kind.channel_us(self)


def _card_type(model: str, settings: type[Settings]) -> type[Card]:
    bases: tuple[type[Any], ...] = (Card, settings)
    return create_model(f"{model}_card", __base__=bases)


CARD_TYPES: Mapping[str, type[Card]] = {
    model: Card if kind.settings is Settings else _card_type(model, kind.settings) for model, kind in KINDS.items()
}
"""Classes of cards by model; a kind without settings of its own uses `Card`."""

_SETTINGS = {key for kind in KINDS.values() for key in kind.settings.model_fields}


def _of_its_kind(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
    """A card with the settings of its kind. If the model is wrong, settings of any kind pass."""
    if not isinstance(value, Mapping):
        return handler(value)
    model = value.get("model")
    if isinstance(model, str) and model in CARD_TYPES:
        return CARD_TYPES[model].model_validate(value)
    return handler({key: each for key, each in value.items() if key not in _SETTINGS})


class Supervision(Table):
    """Limits beyond which the controller reacts. A limit that is left out is derived from the cell for each joint;
    `canarm check --detectors` shows them.
    """

    missing_cycles: Annotated[int, Field(ge=1, le=1000)] | None = None
    silent_card_ms: Annotated[int, Field(ge=1, le=10_000)] | None = None
    range_margin_deg: NonNegative | None = None
    max_position_step_deg: Positive | None = None
    position_jump_lsb: Positive | None = None
    position_drift_lsb: Positive | None = None
    speed_jump_lsb: Positive | None = None
    speed_drift_lsb: Positive | None = None
    current_mismatch_a: Positive | None = None
    acceleration_mismatch_rad_s2: Positive | None = None


class Cell(Table):
    """A whole cell; see the shipped `cells/konkuk1.toml` for every key with its unit."""

    name: Name
    title: str
    bus: Bus
    physics: Physics
    robot: Annotated[tuple[Robot, ...], Field(min_length=1, max_length=7)]
    card: Annotated[
        tuple[Annotated[SerializeAsAny[Card], WrapValidator(_of_its_kind)], ...], Field(min_length=1, max_length=49)
    ]
    object: Carried | None = None
    control: Control
    supervision: Supervision = Supervision()

    @property
    def laden(self) -> tuple[Robot, ...]:
        """The robots with what each carries of the object as a part of its last link."""
        loads = {} if self.object is None else self.object.loads()
        return tuple(robot.carrying(loads[robot.name]) if robot.name in loads else robot for robot in self.robot)

    @property
    def carry_refresh_cycles(self) -> int:
        """Cycles from one error value that the controller writes anew to the next; 0: it writes none."""
        interval_ms = self.bus.carry_refresh_ms
        if interval_ms is None or not any(robot.when_lost == "carry" for robot in self.robot):
            return 0
        return -(-interval_ms * 1000 // self.bus.cycle_us)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """All joints, robot by robot, base to tip."""
        return tuple(joint for robot in self.robot for joint in robot.joint)

    @property
    def blocks(self) -> tuple[slice, ...]:
        """For each robot, where its joints stand in `joints`."""
        ends = itertools.accumulate(len(robot.joint) for robot in self.robot)
        return tuple(slice(end - len(robot.joint), end) for robot, end in zip(self.robot, ends, strict=True))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Unique names of `joints`, in the same order: `<robot>_<joint>` where robots share a joint name."""
        count = Counter(joint.name for joint in self.joints)
        return tuple(
            f"{robot.name}_{joint.name}" if count[joint.name] > 1 else joint.name
            for robot in self.robot
            for joint in robot.joint
        )

    @property
    def hands(self) -> dict[int, str]:
        """Which hand is at which joint (index in `joints`) of the robots that carry the object: "master", "slave"."""
        if self.object is None:
            return {}
        names = {self.object.master: "master", self.object.slave: "slave"}
        blocks = zip(self.robot, self.blocks, strict=True)
        return {own.stop - 1: names[robot.name] for robot, own in blocks if robot.name in names}

    def joint_index(self, robot: str, joint: str) -> int:
        """Index in `joints` of a robot's joint, by both names. Raises `KeyError`."""
        places = ((each.name, joint.name) for each in self.robot for joint in each.joint)
        for index, place in enumerate(places):
            if place == (robot, joint):
                return index
        raise KeyError(f"{robot}.{joint}")

    def far_joint(self, card: Card, channel: Channel) -> int:
        """Index in `joints` of the joint to which a channel of `card` is wired. Raises `KeyError`."""
        return self.joint_index(card.robot, channel.joint)
