"""Values of objects as text, by their type: bytes as CiA 301, 7.1.4 lays them out."""

import pytest
from canopen.objectdictionary import ODVariable, datatypes

from canarm_protocol.canopen.values import ValueTextError, type_text, value_bytes, value_text


def variable(data_type, low=None, high=None):
    made = ODVariable("a", 0x2000)
    made.data_type, made.min, made.max = data_type, low, high
    return made


@pytest.mark.parametrize(
    ("kind", "text", "data"),
    [
        (datatypes.UNSIGNED8, "255", "ff"),
        (datatypes.UNSIGNED16, "0x1234", "3412"),
        (datatypes.INTEGER16, "-2", "feff"),
        (datatypes.INTEGER24, "-1", "ffffff"),
        (datatypes.UNSIGNED64, "1", "0100000000000000"),
        (datatypes.BOOLEAN, "true", "01"),
        (datatypes.REAL32, "1.5", "0000c03f"),  # IEEE 754: 0x3FC00000
        (datatypes.VISIBLE_STRING, "abc", "616263"),
        (datatypes.DOMAIN, "01 ff:7F", "01ff7f"),
    ],
)
def test_a_text_becomes_the_bytes_of_its_type(kind, text, data):
    assert value_bytes(variable(kind), text).hex() == data


@pytest.mark.parametrize(
    ("kind", "text", "right"),
    [
        (datatypes.UNSIGNED8, "256", "from 0 to 255"),
        (datatypes.UNSIGNED8, "-1", "from 0 to 255"),
        (datatypes.INTEGER16, "40000", "from -32768 to 32767"),
        (datatypes.UNSIGNED32, "9" * 5000, "from 0 to 4294967295"),
        (datatypes.UNSIGNED8, "٣", "from 0 to 255"),
        (datatypes.BOOLEAN, "2", "0 or 1"),
        (datatypes.REAL32, "1e99", "REAL32"),
        (datatypes.REAL32, "nan", "finite"),
        (datatypes.VISIBLE_STRING, "é", "ASCII"),
        (datatypes.DOMAIN, "0", "hexadecimal"),
        (datatypes.DOMAIN, "\x1b[2J", "hexadecimal"),
    ],
)
def test_a_text_that_does_not_fit_is_refused_with_what_would(kind, text, right):
    with pytest.raises(ValueTextError, match=right) as error:
        value_bytes(variable(kind), text)
    assert "\x1b" not in str(error.value)


def test_the_limits_of_the_data_sheet_hold_unless_they_are_lifted():
    limited = variable(datatypes.UNSIGNED8, 1, 240)
    assert type_text(limited) == "unsigned8 1 to 240"
    with pytest.raises(ValueTextError, match="from 1 to 240"):
        value_bytes(limited, "0")
    assert value_bytes(limited, "0", is_limited=False) == b"\0"


@pytest.mark.parametrize(
    ("kind", "data", "text"),
    [
        (datatypes.INTEGER16, "feff", "-2 (0xFFFE)"),
        (datatypes.REAL32, "0000c03f", "1.5 (0x3FC00000)"),
        (datatypes.VISIBLE_STRING, "1b5b324a", r"\x1b[2J"),
        (datatypes.UNSIGNED32, "0102", "01 02"),
        (datatypes.DOMAIN, "00" * 100, "00 " * 63 + "00…"),
    ],
)
def test_bytes_become_text_by_their_type_and_are_safe_to_show(kind, data, text):
    assert value_text(variable(kind), bytes.fromhex(data)) == text


def test_without_a_type_bytes_are_shown_and_typed():
    assert value_text(None, b"\x01\x02") == "01 02"
    assert value_bytes(None, "0102") == b"\x01\x02"
