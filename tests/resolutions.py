"""konkuk1 with converters of another resolution, for tests of cards and of whole loops."""

import re

from canarm_protocol.cell.cell_file import parse_cell, shipped_cells
from canarm_protocol.cell.control import Homing
from canarm_protocol.cell.model import Cell


def _konkuk1() -> str:
    """Without the limits that its file gives in steps of eight bits; what the cell does not say is derived."""
    return re.sub(r"\n[a-z_]+_lsb = [^\n]*(?=\n(?:.*\n)*?\[\[robot\]\])", "", shipped_cells()["konkuk1"])


def cell_of_bits(bits: int) -> Cell:
    """konkuk1 with a `dac` and an `adc` of `bits` bits in the slots of its DAC0808 and its ADC0809."""
    text = _konkuk1()
    text = text.replace('model = "dac0808"', f'model = "dac"\nbits = {bits}')
    return parse_cell(text.replace('model = "adc0809"', f'model = "adc"\nbits = {bits}'), f"konkuk1 with {bits} bits")


def cell_of_two_adcs(second_us: int = 150) -> Cell:
    """konkuk1 with the sensors of joint 3 at an ADC of 12 bits in slot 5, `second_us` a channel."""
    text, _, channels = _konkuk1().partition('model = "adc0809"')
    head, wires = channels.split("channel = [")
    lines = [line.strip() for line in wires.splitlines() if "signal" in line]
    first = "\n".join(line for line in lines if "joint2" in line)
    second = "\n".join(line for line in lines if "joint3" in line)
    card = '[[card]]\nname = "second"\nmodel = "adc"\nrobot = "konkuk1"\nslot = 5\nnode_id = 0x15\nbits = 12\n'
    rest = wires.split("\n]", 1)[1]
    text += f'model = "adc0809"{head}channel = [\n{first}\n]\n\n'
    text += f"{card}conversion_us = {second_us}\nchannel = [\n{second}\n]\n{rest}"
    return parse_cell(text, "konkuk1 with two ADCs")


def cell_of_encoders(lines: int = 2048, counter_bits: int = 32) -> Cell:
    """konkuk1 with an encoder on each joint's shaft, at an encoder counter in slot 5, instead of its potentiometers."""
    text = re.sub(r"\[robot\.joint\.sensors\.potentiometer\](\n[^\n\[]+)+", "", _konkuk1())
    encoder = f"[robot.joint.sensors.encoder]\nlines = {lines}\n\n"
    text = text.replace("[robot.joint.sensors.tachometer]", f"{encoder}[robot.joint.sensors.tachometer]")
    text = re.sub(r" *\{[^}]*potentiometer[^}]*\},\n", "", text)
    card = '[[card]]\nname = "counter"\nmodel = "encoder_counter"\nrobot = "konkuk1"\nslot = 5\nnode_id = 0x15\n'
    wires = [f'{{ number = {n}, signal = "joint{n + 1}.encoder" }}' for n in (1, 2)]
    text += f"\n{card}counter_bits = {counter_bits}\nchannel = [{', '.join(wires)}]\n"
    return parse_cell(text, "konkuk1 with encoders")


def homed(cell: Cell, parked_within_deg: float = 0.5, speed_deg_s: float = 40.0) -> Cell:
    """A cell whose joints are homed by the index of their encoders."""
    homing = Homing(parked_within_deg=parked_within_deg, speed_deg_s=speed_deg_s)
    return cell.model_copy(update={"control": cell.control.model_copy(update={"homing": homing})})
