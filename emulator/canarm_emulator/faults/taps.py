"""The taps of a cell: every arrow of the signal path by name.

Names come from the cell's joints and cards. `points.py` has what stands behind a tap inside the bench.
"""

from canarm_protocol.cards import Wire
from canarm_protocol.cell.model import Card, Cell, Channel, Command
from canarm_protocol.shown import quoted

from ..robot.drives import DRIVES
from ..robot.sensors import SENSORS
from .declaration import Tap, TapKind

_OF_A_CARD = {
    Wire.CURRENT_COMMAND: (TapKind.DAC_CODE, "LSB"),
    Wire.DIRECTION: (TapKind.LATCH, ""),
    Wire.VOLTAGE: (TapKind.ADC_CODE, "LSB"),
    Wire.PULSES: (TapKind.ADC_CODE, "LSB"),
}
"""Kind and unit of the signals at the channels of a card."""

_OF_A_JOINT = (
    ("amplifier.supply", TapKind.SUPPLY, "supply of amplifier and motor"),
    ("motor", TapKind.MOTOR, "motor, its winding and its leads"),
    ("brake", TapKind.BRAKE, "brake at the motor's shaft"),
    ("wire", TapKind.DRIVE_WIRE, "drive wire between gear and joint"),
    ("link", TapKind.LINK, "link: load, friction, obstacles"),
)


def taps_of(cell: Cell) -> dict[str, Tap]:
    """Every tap of `cell` by its name, along the signal path joint by joint, then converters, bus, nodes and clock."""
    taps: list[Tap] = []
    wired = {
        (cell.far_joint(card, channel), channel.leaf): (card, channel) for card in cell.card for channel in card.channel
    }
    for index, (name, joint) in enumerate(zip(cell.joint_names, cell.joints, strict=True)):
        if (command := wired.get((index, Command.CURRENT))) is not None:
            taps.append(_card_tap(cell, *command))
            steps = command[0].codec.full_scale
            for stage in DRIVES[joint.drive.kind].stages(joint):
                kind = TapKind.OPAMP if stage.unit == "V" else TapKind.CURRENT
                step = stage.high / steps
                taps.append(Tap(f"{name}.{stage.name}", kind, stage.about, stage.unit, 0, stage.high, step, index))
        if (direction := wired.get((index, Command.DIRECTION))) is not None:
            taps.append(_card_tap(cell, *direction))
        taps += [
            Tap(f"{name}.{leaf}", kind, about, joint=index)
            for leaf, kind, about in _OF_A_JOINT
            if kind is not TapKind.BRAKE or joint.brake is not None
        ]
        for sensor in joint.sensors.fitted():
            pin = SENSORS[sensor.kind].stage(sensor)
            if pin is not None and (index, sensor.kind) in wired:
                step = pin.high / wired[index, sensor.kind][0].codec.full_scale
                tap = Tap(f"{name}.{pin.name}", TapKind.SENSOR, pin.about, pin.unit, 0, pin.high, step, index)
                taps.append(tap)
    if cell.object is not None:
        hands = {"master": cell.object.master, "slave": cell.object.slave}
        taps += [Tap(f"object.{hand}", TapKind.GRIP, f"hand of {robot} on the object") for hand, robot in hands.items()]
    for card in cell.card:
        if not card.kind.is_output:
            taps += [_card_tap(cell, card, channel) for channel in card.channel]
    taps.append(Tap("can0.rx", TapKind.MESSAGES, "frames on their way to the cards"))
    taps.append(Tap("can0.tx", TapKind.MESSAGES, "frames that the cards send"))
    taps.append(Tap("can0.wire", TapKind.BUS, "the robot's bus as a wire (needs the wire model)"))
    taps += [
        Tap(f"node.0x{card.node_id:02X}", TapKind.NODE, f"card {quoted(card.name)} as a node", node_id=card.node_id)
        for card in cell.card
    ]
    taps.append(Tap("bench.clock", TapKind.CLOCK, "the bench's time between two SYNCs"))
    taps += [_card_tap(cell, *place) for (_, leaf), place in wired.items() if leaf == Command.GRIP]
    return {tap.name: tap for tap in taps}


def _card_tap(cell: Cell, card: Card, channel: Channel) -> Tap:
    """Where faults reach the code of a card's channel."""
    (kind, unit), codec, joint = _OF_A_CARD[card.kind.takes], card.codec, cell.far_joint(card, channel)
    name = card.kind.tap.format(joint=cell.joint_names[joint], card=card.name, number=channel.number)
    about = card.kind.tap_about.format(signal=f"{cell.joint_names[joint]}.{channel.leaf}")
    if channel.leaf == Command.GRIP:
        name, about = (
            f"{cell.joint_names[joint]}.{Command.GRIP}",
            "bits of the hand behind the latch: 1 closes, 2 opens",
        )
    return Tap(name, kind, about, unit, codec.lowest, codec.full_scale, 1, joint, card.node_id, channel.number)
