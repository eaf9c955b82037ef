"""The taps of a cell: every arrow of the signal path by name.

Names come from the cell's joints and cards. What hangs on a tap inside the bench belongs to `points.py`.
"""

from canarm_protocol.cell.model import CardModel, Cell, Quantity

from .declaration import Tap, TapKind

CODE_STEPS = 255
LATCH_HIGHEST = 3

_SENSORS = {
    Quantity.POTENTIOMETER: "potentiometer's voltage at the ADC's pin",
    Quantity.TACHOMETER: "tachometer's voltage at the ADC's pin",
    Quantity.CURRENT_SENSE: "current sense's voltage at the ADC's pin",
}
_OF_A_JOINT = (
    ("amplifier.supply", TapKind.SUPPLY, "supply of amplifier and motor"),
    ("motor", TapKind.MOTOR, "motor, its winding and its leads"),
    ("wire", TapKind.DRIVE_WIRE, "drive wire between gear and joint"),
    ("link", TapKind.LINK, "link: load, friction, obstacles"),
)


def taps_of(cell: Cell) -> dict[str, Tap]:
    """Every tap of `cell` by its name, along the signal path joint by joint, then converters, bus, nodes and clock."""
    taps: list[Tap] = []
    wired = {channel.signal for card in cell.card for channel in card.channel}
    for index, joint in enumerate(cell.joints):
        name, sensors = joint.name, joint.sensors
        amplifier = joint.amplifier
        volts, amperes = amplifier.opamp_full_scale_v, amplifier.max_current_a
        if f"{name}.{Quantity.CURRENT_COMMAND}" in wired:
            about = "code behind the DAC's latches"
            taps.append(Tap(f"{name}.dac.code", TapKind.DAC_CODE, about, "LSB", 0, CODE_STEPS, 1, index))
            step_v, step_a = volts / CODE_STEPS, amperes / CODE_STEPS
            taps.append(Tap(f"{name}.opamp", TapKind.OPAMP, "op-amp's output", "V", 0, volts, step_v, index))
            about = "magnitude of the current that the amplifier is asked for"
            taps.append(Tap(f"{name}.amplifier.current", TapKind.CURRENT, about, "A", 0, amperes, step_a, index))
        if f"{name}.{Quantity.DIRECTION}" in wired:
            about = "direction bits behind the latch: 1 clockwise, 2 counter-clockwise"
            taps.append(Tap(f"{name}.latch", TapKind.LATCH, about, "", 0, LATCH_HIGHEST, 1, index))
        taps += [Tap(f"{name}.{leaf}", kind, about, joint=index) for leaf, kind, about in _OF_A_JOINT]
        for quantity, about in _SENSORS.items():
            if f"{name}.{quantity}" in wired:
                high_v = sensors.full_scale_v
                step_v = high_v / CODE_STEPS
                taps.append(Tap(f"{name}.{quantity}", TapKind.SENSOR, about, "V", 0, high_v, step_v, index))
    for card in cell.card:
        if card.model is CardModel.ADC0809:
            for channel in card.channel:
                about = f"code of {channel.signal} after the conversion"
                tap = Tap(
                    f"{card.name}.channel{channel.number}", TapKind.ADC_CODE, about, "LSB", 0, CODE_STEPS, 1,
                    cell.joint_names.index(channel.joint), card.node_id, channel.number,
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
