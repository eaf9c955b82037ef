"""PDO layouts as EDS files and mapping entries give them, and the bytes they stand for."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm_protocol.canopen.dictionary import default_value, load_dictionary
from canarm_protocol.canopen.pdo import (
    DISABLED,
    MappedObject,
    PdoLayout,
    mapped_object,
    pdo_numbers,
    read_layout,
    read_layouts,
)
from canarm_protocol.errors import DictionaryError

DAC = load_dictionary("dac0808", 0x12)
ADC = load_dictionary("adc0809", 0x14)


def read_dac(index: int, subindex: int) -> int:
    return default_value(DAC, index, subindex)


def test_the_layout_comes_from_the_eds() -> None:
    (layout,) = read_layouts(DAC, "rpdo", read_dac)
    assert (layout.kind, layout.number, layout.cob_id, layout.transmission_type) == ("rpdo", 2, 0x312, 1)
    assert [mapped.entry for mapped in layout.objects] == [0x64110110, 0x64110210, 0x64110310, 0x64110410]
    assert layout.size == 8
    assert read_layouts(DAC, "tpdo", read_dac) == []


def test_pdos_are_numbered_by_their_index() -> None:
    assert list(pdo_numbers(DAC, "rpdo")) == [2]
    assert list(pdo_numbers(ADC, "tpdo")) == [2, 3]


def test_values_travel_little_endian_and_signed() -> None:
    (layout,) = read_layouts(DAC, "rpdo", read_dac)
    assert layout.pack(0x80 << 7, 0xFF << 7, 0, -1).hex() == "0040" + "807f" + "0000" + "ffff"
    assert layout.unpack(bytes.fromhex("0040807f0000ffff")) == (0x4000, 0x7F80, 0, -1)


@given(st.lists(st.integers(-(2**15), 2**15 - 1), min_size=4, max_size=4))
def test_what_is_packed_is_unpacked(values: list[int]) -> None:
    (layout,) = read_layouts(DAC, "rpdo", read_dac)
    assert list(layout.unpack(layout.pack(*values))) == values
    assert layout.pack(*values) == struct.pack("<4h", *values)


def test_a_disabled_pdo_is_left_out_but_can_be_looked_at() -> None:
    def read(index: int, subindex: int) -> int:
        return DISABLED | 0x281 if (index, subindex) == (0x1801, 1) else default_value(ADC, index, subindex)

    assert [layout.number for layout in read_layouts(ADC, "tpdo", read)] == [3]
    assert read_layout(ADC, "tpdo", 2, read).cob_id == 0x281


def test_a_layout_can_be_restricted_to_some_objects() -> None:
    (layout,) = read_layouts(DAC, "rpdo", read_dac)
    fewer = layout.restricted_to(lambda mapped: mapped.subindex in (2, 3))
    assert (fewer.cob_id, fewer.number, fewer.size) == (0x312, 2, 4)
    assert fewer.pack(1, 2) == b"\x01\0\x02\0"
    assert repr(fewer) == "<RPDO2 0x312 type 1: 0x6411:02, 0x6411:03>"


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (0x12340010, "mapping entry 0x12340010: the dictionary has no object 0x1234:00"),
        (0x64110510, "mapping entry 0x64110510: the dictionary has no object 0x6411:05"),
        (0x10010108, "mapping entry 0x10010108: the dictionary has no object 0x1001:01"),
        (0x10170010, "mapping entry 0x10170010: 0x1017:00 'Producer heartbeat time' cannot be mapped"),
        (0x64110108, "mapping entry 0x64110108: 0x6411:01 is not 8 bits long in the dictionary"),
        (0x64110100, "mapping entry 0x64110100: 0x6411:01 is not 0 bits long in the dictionary"),
    ],
)
def test_an_entry_that_maps_nothing_says_why(entry: int, message: str) -> None:
    with pytest.raises(DictionaryError) as caught:
        mapped_object(DAC, entry)
    assert str(caught.value) == message


def test_more_than_eight_bytes_do_not_fit_into_a_pdo() -> None:
    with pytest.raises(DictionaryError, match=r"^TPDO1 maps 10 bytes; a PDO has at most 8$"):
        PdoLayout("tpdo", 1, 0x181, 1, [MappedObject(0x6401, n, "h") for n in range(1, 6)])
