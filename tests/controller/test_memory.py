"""The memory image: addresses from the paper, table bytes against the arithmetic of `ASL A` and of the DAC."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm_controller.errors import MemoryImageError
from canarm_controller.reference.memory import MemoryImage, decode_table_byte, encode_table_byte

FULL_SCALE_A = 1.5
TABLE_STEP_A = 2 * FULL_SCALE_A / 255


def shifted_left(byte: int) -> tuple[int, bool]:
    """6502 `ASL A`: accumulator and carry."""
    doubled = byte * 2
    return doubled % 256, doubled >= 256


@pytest.mark.parametrize("byte", range(256))
def test_asl_leaves_the_dac_code_and_the_direction(byte: int) -> None:
    assert decode_table_byte(byte) == shifted_left(byte)


@given(st.floats(-254 / 255 * FULL_SCALE_A, 254 / 255 * FULL_SCALE_A))
def test_a_current_comes_back_within_half_a_table_step(current_a: float) -> None:
    image = MemoryImage(1, FULL_SCALE_A)
    image.load_table(0, np.array([current_a]))
    assert abs(image.table_current_a(0, 0) - current_a) <= TABLE_STEP_A / 2 * (1 + 1e-12)


def test_bytes_of_known_currents() -> None:
    """1.5 A x 2m/255 for magnitude m."""
    currents = np.array([0.0, TABLE_STEP_A, -TABLE_STEP_A, 127 * TABLE_STEP_A, -127 * TABLE_STEP_A, -1e-6])
    assert encode_table_byte(currents, FULL_SCALE_A).tolist() == [0x00, 0x01, 0x81, 0x7F, 0xFF, 0x00]


def test_current_beyond_full_scale_sticks_and_is_counted() -> None:
    image = MemoryImage(2)
    assert image.load_table(1, np.array([9.0, -9.0, 1.5])) == 2
    assert [image.peek(0x3000 + i) for i in range(3)] == [0x7F, 0xFF, 0x7F]


def test_tables_of_two_joints_fill_2000_to_3fff() -> None:
    image = MemoryImage(2)
    image.load_table(0, np.full(4096, TABLE_STEP_A))
    image.load_table(1, np.full(4096, -TABLE_STEP_A))
    dump = image.dump()
    assert dump[:0x1000] == b"\x01" * 4096
    assert dump[0x1000:0x2000] == b"\x81" * 4096
    assert not any(dump[0x2000:])


def test_log_has_pages_of_its_own_from_4000_to_7fff() -> None:
    image = MemoryImage(2)
    image.log(5, (10, 20), (30, 40))
    assert [image.peek(page + 5) for page in (0x4000, 0x5000, 0x6000, 0x7000)] == [10, 20, 30, 40]
    assert not any(image.dump()[:0x2000])
    assert len(image.dump()) == 0x8000 - 0x2000


def test_table_and_log_wrap_after_10_24_seconds() -> None:
    image = MemoryImage(2)
    image.load_table(0, np.array([TABLE_STEP_A]))
    image.log(4096 + 3, (1, 2), (3, 4))
    assert image.table_current_a(0, 4096) == pytest.approx(TABLE_STEP_A)
    assert image.peek(0x7003) == 4


def test_each_joint_has_its_own_scale() -> None:
    image = MemoryImage(2, (1.0, 2.0))
    for joint in (0, 1):
        image.load_table(joint, np.array([0.5]))
    assert image.peek(0x2000) == 64  # 0.5 / (2/255) = 63.75
    assert image.peek(0x3000) == 32  # 0.5 / (4/255) = 31.875


@pytest.mark.parametrize("address", [0x1FFF, 0x8000])
def test_peek_outside_the_image_is_refused(address: int) -> None:
    with pytest.raises(MemoryImageError, match=r"\$2000-\$7FFF"):
        MemoryImage(2).peek(address)


def test_every_two_joints_have_a_bank_at_the_papers_addresses() -> None:
    image = MemoryImage(5)
    image.load_table(3, np.array([TABLE_STEP_A]))
    image.log(2, (11, 12, 13, 14, 15), (21, 22, 23, 24, 25))
    assert image.bank_count == 3
    assert len(image.dump()) == 3 * (0x8000 - 0x2000)
    assert image.peek(0x3000, bank=1) == 1
    assert image.dump()[1 * 0x6000 + 0x1000] == 1
    assert [image.peek(page + 2, bank=1) for page in (0x4000, 0x5000, 0x6000, 0x7000)] == [13, 14, 23, 24]
    assert [image.peek(page + 2, bank=2) for page in (0x4000, 0x5000, 0x6000, 0x7000)] == [15, 0, 25, 0]


def test_what_is_read_a_cycle_is_the_table_as_it_stands() -> None:
    image = MemoryImage(3)
    page, currents = image.table_bytes(2), image.currents_by_byte(2)
    image.load_table(2, np.array([0.0, -3 * TABLE_STEP_A]))
    assert currents[page[1]] == image.table_current_a(2, 1) == pytest.approx(-3 * TABLE_STEP_A)
    assert len(page) == 4096


def test_an_image_without_joints_or_beyond_its_banks_is_refused() -> None:
    with pytest.raises(MemoryImageError, match="0 joints; must be of 1 at least"):
        MemoryImage(0)
    with pytest.raises(MemoryImageError, match="bank 2: 4 joints take banks 0 to 1"):
        MemoryImage(4).peek(0x2000, bank=2)


@pytest.mark.parametrize(
    ("joint", "currents", "message"),
    [
        (2, np.zeros(1), "joints 0 to 1"),
        (0, np.zeros(4097), "n <= 4096"),
        (0, np.array([0.0, np.nan]), "sample 1: nan"),
    ],
)
def test_a_bad_table_is_refused(joint: int, currents: np.ndarray, message: str) -> None:
    with pytest.raises(MemoryImageError, match=message):
        MemoryImage(2).load_table(joint, currents)


@pytest.mark.parametrize("scale", [(1.5,), (1.5, 0.0)])
def test_scales_must_be_positive_and_one_a_joint(scale: tuple[float, ...]) -> None:
    with pytest.raises(MemoryImageError, match="one value for each of 2 joints"):
        MemoryImage(2, scale)


def test_a_code_that_is_no_byte_is_refused() -> None:
    with pytest.raises(MemoryImageError, match=r"log at sample 7: positions \[256, 0\]"):
        MemoryImage(2).log(7, (256, 0), (0, 0))
