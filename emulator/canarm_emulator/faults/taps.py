"""The taps of a cell: every arrow of the signal path by name.

Names come from the cell's joints and cards. What hangs on a tap inside the bench belongs to `points.py`.
"""

from canarm_protocol.cell.model import CardModel, Cell, Command
from canarm_protocol.cell.sensors import AnalogueSensor

from .declaration import Tap, TapKind

CODE_STEPS = 255
LATCH_HIGHEST = 3

_OF_A_JOINT = (
    ("amplifier.supply", TapKind.SUPPLY, "supply of amplifier and motor"),
    ("motor", TapKind.MOTOR, "motor, its winding and its leads"),
    ("wire", TapKind.DRIVE_WIRE, "drive wire between gear and joint"),
    ("link", TapKind.LINK, "link: load, friction, obstacles"),
)


def taps_of(cell: Cell) -> dict[str, Tap]:
    """Every tap of `cell` by its name, along the signal path joint by joint, then converters, bus, nodes and clock."""
    taps: list[Tap] = []
    wired = {(cell.far_joint(card, channel), channel.leaf) for card in cell.card for channel in card.channel}
    for index, (name, joint) in enumerate(zip(cell.joint_names, cell.joints, strict=True)):
        volts, amperes = joint.drive.opamp_full_scale_v, joint.drive.max_current_a
        if (index, Command.CURRENT) in wired:
            about = "code behind the DAC's latches"
            taps.append(Tap(f"{name}.dac.code", TapKind.DAC_CODE, about, "LSB", 0, CODE_STEPS, 1, index))
            step_v, step_a = volts / CODE_STEPS, amperes / CODE_STEPS
            taps.append(Tap(f"{name}.opamp", TapKind.OPAMP, "op-amp's output", "V", 0, volts, step_v, index))
            about = "magnitude of the current that the amplifier is asked for"
            taps.append(Tap(f"{name}.amplifier.current", TapKind.CURRENT, about, "A", 0, amperes, step_a, index))
        if (index, Command.DIRECTION) in wired:
            about = "direction bits behind the latch: 1 clockwise, 2 counter-clockwise"
            taps.append(Tap(f"{name}.latch", TapKind.LATCH, about, "", 0, LATCH_HIGHEST, 1, index))
        taps += [Tap(f"{name}.{leaf}", kind, about, joint=index) for leaf, kind, about in _OF_A_JOINT]
        for sensor in joint.sensors.fitted():
            if (index, sensor.kind) in wired and isinstance(sensor, AnalogueSensor):
                high_v, about = sensor.full_scale_v, f"{sensor.title}'s voltage at the ADC's pin"
                step_v = high_v / CODE_STEPS
                taps.append(Tap(f"{name}.{sensor.kind}", TapKind.SENSOR, about, "V", 0, high_v, step_v, index))
    for card in cell.card:
        if card.model is CardModel.ADC0809:
            for channel in card.channel:
                joint_index = cell.far_joint(card, channel)
                about = f"code of {cell.joint_names[joint_index]}.{channel.leaf} after the conversion"
                tap = Tap(
                    f"{card.name}.channel{channel.number}", TapKind.ADC_CODE, about, "LSB", 0, CODE_STEPS, 1,
                    joint_index, card.node_id, channel.number,
                )  # fmt: skip
                taps.append(tap)
    taps.append(Tap("can0.rx", TapKind.MESSAGES, "frames on their way to the cards"))
    taps.append(Tap("can0.tx", TapKind.MESSAGES, "frames that the cards send"))
    taps.append(Tap("can0.wire", TapKind.BUS, "the robot's bus as a wire (needs the wire model)"))
    taps += [
        Tap(f"node.0x{card.node_id:02X}", TapKind.NODE, f"card {card.name!r} as a node", node_id=card.node_id)
        for card in cell.card
    ]
    taps.append(Tap("bench.clock", TapKind.CLOCK, "the bench's time between two SYNCs"))
    return {tap.name: tap for tap in taps}
