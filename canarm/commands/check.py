"""`canarm check`: whether a cell is right, and what can be set in it."""

from typing import Annotated

from cyclopts import Parameter

from canarm_controller.dynamics import nominal_arm
from canarm_controller.supervision.derivation import detector_lines
from canarm_emulator.robot.truth import truth_keys
from canarm_protocol.cell.model import Cell, Joint
from canarm_protocol.cell.schedulability import cell_verdict
from canarm_protocol.cell.settings import setting_keys
from canarm_protocol.cell.wiring import card_nodes

from ..announced import announced
from ..options import CellOptions, Flag
from ..rehearsal import REHEARSED_S, rehearse
from ..usage import UsageError, value_text


def check(
    *,
    cell: CellOptions = CellOptions(),
    keys: Annotated[Flag, Parameter(help="List every key of --truth and --set with unit and nominal value.")] = False,
    detectors: Annotated[
        Flag, Parameter(help="What watches each joint, from which limit on, and where the limit comes from.")
    ] = False,
) -> int:
    """Validate a cell file and show what it describes."""
    nominal = cell.load()
    if keys:
        _print_keys(nominal)
        return 0
    if detectors:
        print("\n".join(detector_lines(nominal)))
        return 0
    _print_cell(nominal)
    verdict = cell_verdict(nominal)
    if not verdict.fits:
        raise UsageError("\n".join((f"{cell.cell}: the cyclic traffic does not fit the bus", *verdict.lines)))
    print("\n".join(verdict.lines))
    notes: list[str] = []
    try:
        with announced(f"trying the cell: {REHEARSED_S:g} s with each law"):
            notes += rehearse(nominal)
    except UsageError as error:
        raise UsageError("\n".join(f"{cell.cell}: {line}" for line in str(error).splitlines())) from None
    finally:
        for note in notes:
            print(note)
    print("ok")
    return 0


def _print_cell(cell: Cell) -> None:
    print(f"{cell.name}: {cell.title}")
    print(
        f"bus: {cell.bus.bitrate} bit/s, cycle {cell.bus.cycle_us} us, controller is node {cell.bus.controller_node_id}"
    )
    for node in card_nodes(cell):
        card = node.card
        print(f"card {card.name}: {card.model} in slot {card.slot} of {card.robot}, node 0x{card.node_id:02X}")
        for layout in (*node.rpdos, *node.tpdos):
            wires = {channel.number: channel.signal for channel in card.channel}
            if len(layout.objects) == 1 and len(wires) > 1:
                signals = ", ".join(wires.values())
            else:
                signals = ", ".join(wires[mapped.subindex] for mapped in layout.objects)
            print(f"  {layout.kind.upper()}{layout.number} 0x{layout.cob_id:03X}: {signals}")
    names = iter(cell.joint_names)
    for robot in cell.robot:
        arm = nominal_arm(robot)
        for joint, inertia, per_ampere in zip(robot.joint, arm.effective_inertia, arm.torque_per_ampere, strict=True):
            control = cell.control.of_joint(next(names))
            print(
                f"joint {joint.name}: {joint.limits_deg[0]:g} to {joint.limits_deg[1]:g} deg, "
                f"{inertia:.4g} kg m2, {per_ampere:.3g} N m/A, at most {joint.drive.max_current_a:g} A; "
                f"loop {control.natural_frequency_rad_s:g} rad/s, damping {control.damping_ratio:g}"
                f"{_reversed(joint)}"
            )


def _reversed(joint: Joint) -> str:
    """Which of the joint's parts work the other way round."""
    parts = [sensor.title for sensor in joint.sensors.fitted() if sensor.is_reversed]
    if joint.motor.direction < 0:
        parts.insert(0, "drive")
    return f"; reversed: {', '.join(parts)}" if parts else ""


def _print_keys(cell: Cell) -> None:
    print("--truth, what differs from nominal in the true robot:")
    for key in truth_keys(cell):
        print(f"  {key.name:<34} {key.nominal:<12g} {key.unit:<10} {key.description}")
    print("--set, gains and limits of the controller, and what robots carry:")
    for name, value in setting_keys(cell).items():
        print(f"  {name:<46} {value_text(value)}")
