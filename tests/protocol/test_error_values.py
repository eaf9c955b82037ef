"""What an output takes when the controller is lost, as the cell chooses (CiA 401: 0x6206/0x6207, 0x6443/0x6444)."""

import math

import pytest

from canarm_controller.dynamics import cell_arm
from canarm_protocol.cell.cell_file import load_cell, parse_cell, shipped_cells
from canarm_protocol.cell.configuration import card_settings, final_values
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.errors import CellError

TEXT = shipped_cells()["konkuk1"]


def wired(signal: str, error_value: int) -> str:
    found = f'signal = "{signal}" }}'
    assert TEXT.count(found) == 1
    return TEXT.replace(found, f'signal = "{signal}", error_value = {error_value} }}')


def settings(text: str, card: str) -> dict[tuple[int, int], int]:
    cell = parse_cell(text, "cell.toml")
    (node,) = [node for node in card_nodes(cell) if node.card.name == card]
    return final_values(card_settings(node, cell.bus))


def test_unless_the_cell_says_otherwise_outputs_go_to_zero() -> None:
    dac, latch = settings(TEXT, "dac"), settings(TEXT, "latch")
    assert [dac[0x6443, channel] for channel in (1, 2, 3, 4)] == [1, 1, 1, 1]
    assert [dac[0x6444, channel] for channel in (1, 2, 3, 4)] == [0, 0, 0, 0]
    assert (latch[0x6206, 1], latch[0x6207, 1]) == (0xFF, 0)


def test_a_dac_code_is_left_adjusted_in_32_bits() -> None:
    """CiA 401: the value is left-adjusted; an 8-bit code c of a signed 16-bit output is c << 7, in 32 bits c << 23."""
    assert settings(wired("joint3.current_command", 100), "dac")[0x6444, 2] == 100 << 23


def test_direction_bits_stand_at_their_channel() -> None:
    assert settings(wired("joint3.direction", 0b10), "latch")[0x6207, 1] == 0b1000


@pytest.mark.parametrize(
    ("signal", "value", "complaint"),
    [
        ("joint3.direction", 3, "card 'latch'.channel 2.error_value = 3: must be from 0 to 2"),
        ("joint2.tachometer", 1, "card 'adc'.channel 3.error_value = 1: an input has none; leave it out"),
        ("joint2.current_command", 256, "must be"),
    ],
)
def test_an_error_value_that_cannot_be_is_refused(signal: str, value: int, complaint: str) -> None:
    with pytest.raises(CellError, match=complaint):
        parse_cell(wired(signal, value), "cell.toml")


def test_a_robot_that_holds_keeps_its_wired_outputs_and_no_others() -> None:
    """CiA 401: 0x6443 = 0 and a bit of 0x6206 that is 0 keep an output; channels 3 and 4 of konkuk1 are not wired."""
    text = TEXT.replace("number = 1\n", 'number = 1\nwhen_lost = "hold"\n', 1)
    dac, latch = settings(text, "dac"), settings(text, "latch")
    assert [dac[0x6443, channel] for channel in (1, 2, 3, 4)] == [0, 0, 1, 1]
    assert (latch[0x6206, 1], latch[0x6207, 1]) == (0xF0, 0)


def test_a_robot_that_holds_has_no_error_values() -> None:
    text = wired("joint3.current_command", 100).replace("number = 1\n", 'number = 1\nwhen_lost = "hold"\n', 1)
    with pytest.raises(CellError, match=r"channel 2.error_value = 100: robot 'konkuk1' has when_lost = \"hold\""):
        parse_cell(text, "cell.toml")


def test_what_carries_the_pair_is_its_weight_at_home() -> None:
    """The nominal arms' gravity with each one's share of the object, over torque a ampere, in steps of 1.5 A / 255."""
    cell = load_cell("rhino-pair")
    arm = cell_arm(cell.laden, cell.joint_names)
    home = [math.radians(joint.home_deg) for joint in cell.joints]
    held_a = [torque / each for torque, each in zip(arm.gravity(home), arm.torque_per_ampere, strict=True)]
    for card in cell.card:
        for channel in card.channel:
            joint = cell.far_joint(card, channel)
            code = round(abs(held_a[joint]) / 1.5 * 255)
            if channel.leaf == "current_command":
                assert channel.error_value == code
            elif channel.leaf == "direction":
                assert channel.error_value == (0 if not code else 1 if held_a[joint] < 0.0 else 2)
    (node,) = [node for node in card_nodes(cell) if node.card.name == "slave-dac1"]
    values = final_values(card_settings(node, cell.bus))
    assert [values[0x6443, channel] for channel in (1, 2, 3, 4)] == [1, 1, 1, 1]
    assert [values[0x6444, channel] >> 23 for channel in (1, 2, 3, 4)] == [0, 136, 51, 8]
