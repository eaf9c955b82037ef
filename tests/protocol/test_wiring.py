"""EDS mapping and cell wiring joined: which bytes of which frame are which joint's signal."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cards import Codec
from canarm_protocol.cell.cell_file import load_cell, parse_cell, shipped_cells
from canarm_protocol.cell.model import Quantity
from canarm_protocol.cell.output_frames import OutputFrames
from canarm_protocol.cell.sensing import joint_sensors
from canarm_protocol.cell.wiring import InputSlot, card_nodes, input_slots

CELL = load_cell("konkuk1")
NODES = card_nodes(CELL)
BITS_8 = Codec(8, 7)
"""CIA 401: left-adjusted in 16 bits with sign."""
CODES = st.integers(0, 255)
BITS = st.integers(0, 3)


def swapped() -> str:
    """konkuk1 with joint 3 on the latch's channel 4 and the DAC's channel 1."""
    text = shipped_cells()["konkuk1"]
    text = text.replace('{ number = 2, signal = "joint3.direction" }', '{ number = 4, signal = "joint3.direction" }')
    text = text.replace(
        '{ number = 1, signal = "joint2.current_command" }', '{ number = 3, signal = "joint2.current_command" }'
    )
    return text.replace(
        '{ number = 2, signal = "joint3.current_command" }', '{ number = 1, signal = "joint3.current_command" }'
    )


def test_a_code_travels_shifted_left_by_seven_and_directions_two_bits_a_joint() -> None:
    frames = OutputFrames(CELL, NODES).frames([0x80, 0xFF], [0b10, 0b01])
    assert frames == [Frame(0x312, bytes.fromhex("0040807f")), Frame(0x213, bytes([0b0110]))]


@given(st.tuples(CODES, CODES), st.tuples(BITS, BITS))
def test_outputs_are_read_back_from_their_bytes(codes: tuple[int, int], directions: tuple[int, int]) -> None:
    (_, analogue, *_), (_, digital, *_) = OutputFrames(CELL, NODES).frames(codes, directions)
    values = [int.from_bytes(analogue[i : i + 2], "little", signed=True) for i in (0, 2)]
    assert [value >> 7 for value in values] == list(codes)
    assert min(values) >= 0
    assert (digital[0] & 3, digital[0] >> 2) == directions


def test_the_wiring_of_the_cell_decides_where_a_joint_sits() -> None:
    cell = parse_cell(swapped(), "swapped")
    frames = OutputFrames(cell, card_nodes(cell)).frames([1, 2], [0b01, 0b10])
    assert frames == [
        Frame(0x312, (2 << 7).to_bytes(2, "little") + (1 << 7).to_bytes(2, "little")),
        Frame(0x213, bytes([0b1000_0001])),
    ]


def test_only_wired_channels_are_mapped() -> None:
    dac, latch, adc = NODES
    assert [[mapped.subindex for mapped in layout.objects] for layout in dac.rpdos] == [[1, 2]]
    assert [[mapped.subindex for mapped in layout.objects] for layout in latch.rpdos] == [[1]]
    assert [[mapped.subindex for mapped in layout.objects] for layout in adc.tpdos] == [[1, 2, 3, 4], [5, 6]]


def test_every_input_has_its_place_in_a_frame() -> None:
    position, speed, current = Quantity.POSITION, Quantity.VELOCITY, Quantity.CURRENT
    assert input_slots(CELL, NODES) == (
        InputSlot(0x14, 0x294, 0, position, 0, BITS_8),
        InputSlot(0x14, 0x294, 1, position, 1, BITS_8),
        InputSlot(0x14, 0x294, 2, speed, 0, BITS_8),
        InputSlot(0x14, 0x294, 3, speed, 1, BITS_8),
        InputSlot(0x14, 0x394, 0, current, 0, BITS_8),
        InputSlot(0x14, 0x394, 1, current, 1, BITS_8),
    )


def test_sensor_scales_are_those_of_the_parts() -> None:
    """Potentiometer 270 degrees on 0..5 V (1.059 degrees a step), tachometer ±2.5 rad/s (0.0196), current 1.5 A."""
    sensors = joint_sensors(CELL)[0]
    assert sensors.velocity is not None
    assert sensors.current is not None
    angle = sensors.position.scale
    assert math.degrees(angle.step) == pytest.approx(1.059, abs=5e-4)
    assert math.degrees(angle(0)) == pytest.approx(-135.0)
    assert math.degrees(angle(255)) == pytest.approx(135.0)
    speed = sensors.velocity.scale
    assert speed.step == pytest.approx(0.0196, abs=5e-5)
    assert (speed(0), speed(127.5), speed(255)) == pytest.approx((-2.5, 0.0, 2.5))
    current = sensors.current.scale
    assert (current(0), current(255)) == pytest.approx((0.0, 1.5))
