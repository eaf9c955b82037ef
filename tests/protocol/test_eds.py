"""The EDS files, read as plain text by the rules of CiA 306 and as objects by the `canopen` library."""

import configparser
import re

import canopen
import pytest

from canarm_protocol.canopen.dictionary import default_value, eds_text, load_dictionary, variable_at
from canarm_protocol.cards import KINDS
from canarm_protocol.errors import DictionaryError

MODELS = list(KINDS)
NODE_ID = 0x14
MANDATORY = {0x1000, 0x1001, 0x1018}  # CiA 301, 7.5.1
DOMAIN = 0x000F
DATA_TYPES = {0x0001, 0x0002, 0x0003, 0x0004, 0x0005, 0x0006, 0x0007, 0x0009, DOMAIN}
DOMAIN_OBJECT, VAR, ARRAY, RECORD = 0x2, 0x7, 0x8, 0x9
OBJECT = re.compile(r"^[0-9A-F]{4}$")
MEMBER = re.compile(r"^([0-9A-F]{4})sub([0-9A-F]+)$")
DEVICE_TYPES = {"dac0808": 0x0008, "sc300": 0x0002, "adc0809": 0x0004, "dac": 0x0008, "adc": 0x0004}
"""The high word of 0x1000 (CiA 401, 6.1): analogue outputs, digital outputs, analogue inputs."""
IO_MODULES = list(DEVICE_TYPES)
"""Other kinds follow other profiles; their own tests say which."""


def sections(model: str) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(interpolation=None, strict=True)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(eds_text(model))
    return parser


def listed(parser: configparser.ConfigParser, section: str) -> list[int]:
    count = int(parser[section]["SupportedObjects"])
    assert len(parser[section]) == count + 1
    return [int(parser[section][str(number)], 16) for number in range(1, count + 1)]


@pytest.mark.parametrize("model", MODELS)
def test_the_file_has_the_sections_of_cia_306_and_no_line_beyond_its_255_characters(model: str) -> None:
    parser = sections(model)
    assert {"FileInfo", "DeviceInfo", "DummyUsage", "Comments", "MandatoryObjects", "OptionalObjects"} <= set(
        parser.sections()
    )
    assert parser["FileInfo"]["FileName"] == f"{model}.eds"
    assert re.fullmatch(r"\d\d:\d\d(AM|PM)", parser["FileInfo"]["CreationTime"])
    assert re.fullmatch(r"\d\d-\d\d-\d{4}", parser["FileInfo"]["CreationDate"])
    assert int(parser["Comments"]["Lines"]) == len(parser["Comments"]) - 1
    assert max(map(len, eds_text(model).splitlines())) <= 255
    assert eds_text(model).isascii()


@pytest.mark.parametrize("model", MODELS)
def test_the_object_lists_name_exactly_the_objects_that_are_described(model: str) -> None:
    parser = sections(model)
    mandatory, optional = listed(parser, "MandatoryObjects"), listed(parser, "OptionalObjects")
    manufacturer = listed(parser, "ManufacturerObjects")
    assert set(mandatory) == MANDATORY
    assert all(0x1000 <= index < 0x2000 or 0x6000 <= index < 0xA000 for index in optional)
    assert all(0x2000 <= index < 0x6000 for index in manufacturer)
    described = [int(name, 16) for name in parser.sections() if OBJECT.match(name)]
    assert sorted(mandatory + optional + manufacturer) == sorted(described)


@pytest.mark.parametrize("model", MODELS)
def test_every_object_is_complete_and_every_member_is_counted(model: str) -> None:
    parser = sections(model)
    members: dict[str, list[int]] = {}
    for name in parser.sections():
        if match := MEMBER.match(name):
            members.setdefault(match[1], []).append(int(match[2], 16))
    for name in parser.sections():
        entry = parser[name]
        if OBJECT.match(name) and int(entry["ObjectType"], 16) in (ARRAY, RECORD):
            assert int(entry["SubNumber"]) == len(members.pop(name)), name
            assert f"{name}sub0" in parser
        elif OBJECT.match(name) or MEMBER.match(name):
            is_domain = int(entry["DataType"], 16) == DOMAIN
            assert int(entry["ObjectType"], 16) == (DOMAIN_OBJECT if is_domain else VAR)
            assert entry["ParameterName"]
            assert len(entry["ParameterName"]) <= 241
            assert int(entry["DataType"], 16) in DATA_TYPES
            assert entry["AccessType"] in {"ro", "wo", "rw", "rwr", "rww", "const"}
            # Independent readers refuse PDOMapping where nothing can be mapped.
            assert ("PDOMapping" in entry) is not is_domain
            assert is_domain or entry["PDOMapping"] in {"0", "1"}
    assert not members


@pytest.mark.parametrize("model", MODELS)
def test_sub_index_0_gives_the_highest_sub_index(model: str) -> None:
    dictionary = load_dictionary(model, NODE_ID)
    for entry in dictionary.values():
        if not isinstance(entry, canopen.objectdictionary.ODVariable) and entry.index != 0x1003:
            if (0x1600 <= entry.index < 0x1800 or entry.index >= 0x1A00) and entry[0].default == 0:
                continue  # of a mapping, how many objects are mapped: none in a PDO that is off
            assert entry[0].default == max(entry.subindices), hex(entry.index)


@pytest.mark.parametrize("model", MODELS)
def test_defaults_lie_within_their_limits_and_fit_their_type(model: str) -> None:
    for entry in load_dictionary(model, NODE_ID).values():
        for variable in [entry] if isinstance(entry, canopen.objectdictionary.ODVariable) else entry.values():
            if variable.data_type == DOMAIN:
                continue
            assert variable.default is not None, variable
            assert variable.decode_raw(variable.encode_raw(variable.default)) == variable.default
            if variable.min is not None:
                assert variable.min <= variable.default <= variable.max


@pytest.mark.parametrize("model", IO_MODULES)
def test_the_device_type_says_cia_401_and_what_kind_of_io(model: str) -> None:
    device_type = default_value(load_dictionary(model, NODE_ID), 0x1000)
    assert device_type & 0xFFFF == 401
    assert device_type >> 16 == DEVICE_TYPES[model]


@pytest.mark.parametrize("model", MODELS)
def test_identity_agrees_with_the_device_information(model: str) -> None:
    dictionary = load_dictionary(model, NODE_ID)
    information = dictionary.device_information
    assert default_value(dictionary, 0x1018, 1) == information.vendor_number
    assert default_value(dictionary, 0x1018, 2) == information.product_number
    assert default_value(dictionary, 0x1018, 3) == information.revision_number
    assert default_value(dictionary, 0x1018, 4) == NODE_ID
    products = {default_value(load_dictionary(other, NODE_ID), 0x1018, 2) for other in MODELS}
    assert len(products) == len(MODELS)
    assert information.nr_of_RXPDO == sum(0x1400 <= index < 0x1600 for index in dictionary)
    assert information.nr_of_TXPDO == sum(0x1800 <= index < 0x1A00 for index in dictionary)


@pytest.mark.parametrize("model", IO_MODULES)
def test_cob_ids_follow_the_node_id(model: str) -> None:
    """The predefined connection set (CiA 301, 7.3.5) and CiA 401's default PDOs: digital first, analogue second."""
    dictionary = load_dictionary(model, NODE_ID)
    assert default_value(dictionary, 0x1014) == 0x080 + NODE_ID
    assert default_value(dictionary, 0x1200, 1) == 0x600 + NODE_ID
    assert default_value(dictionary, 0x1200, 2) == 0x580 + NODE_ID
    bases = {0x1400: 0x200, 0x1401: 0x300, 0x1402: 0x400, 0x1800: 0x180, 0x1801: 0x280, 0x1802: 0x380, 0x1803: 0x480}
    found = [index for index in dictionary if index in bases]
    on, off = {
        "dac0808": ([0x1401], []),
        "sc300": ([0x1400], []),
        "adc0809": ([0x1801, 0x1802], []),
        "dac": ([0x1401], [0x1402]),
        "adc": ([0x1801, 0x1802], [0x1800, 0x1803]),
    }[model]
    assert found == sorted(on + off)
    for index in found:
        assert default_value(dictionary, index, 1) == bases[index] + NODE_ID + (0x8000_0000 if index in off else 0)
        assert default_value(dictionary, index, 2) == 1  # every SYNC


def test_default_mappings_are_those_of_cia_401() -> None:
    def mapping(model: str, index: int) -> list[int]:
        dictionary = load_dictionary(model, NODE_ID)
        return [default_value(dictionary, index, 1 + n) for n in range(default_value(dictionary, index, 0))]

    assert mapping("sc300", 0x1600) == [0x62000108]
    assert mapping("dac0808", 0x1601) == [0x64110110, 0x64110210, 0x64110310, 0x64110410]
    assert mapping("adc0809", 0x1A01) == [0x64010110, 0x64010210, 0x64010310, 0x64010410]
    assert mapping("adc0809", 0x1A02) == [0x64010510, 0x64010610, 0x64010710, 0x64010810]


def test_the_cards_have_as_many_channels_as_a_cell_may_wire() -> None:
    indices = {"dac0808": [0x6411], "adc0809": [0x6401], "dac": [0x6411, 0x6412], "adc": [0x6401, 0x6402]}
    for model, index in ((model, index) for model, several in indices.items() for index in several):
        assert default_value(load_dictionary(model, NODE_ID), index, 0) == KINDS[model].channels


def test_error_values_are_off_by_default() -> None:
    dac, latch = load_dictionary("dac0808", NODE_ID), load_dictionary("sc300", NODE_ID)
    assert [default_value(dac, 0x6443, n) for n in range(1, 5)] == [1] * 4
    assert [default_value(dac, 0x6444, n) for n in range(1, 5)] == [0] * 4
    assert (default_value(latch, 0x6206, 1), default_value(latch, 0x6207, 1)) == (0xFF, 0)


def test_only_what_is_there_is_found() -> None:
    dictionary = load_dictionary("dac0808", NODE_ID)
    assert variable_at(dictionary, 0x6411, 4).name == "Analogue output 4"
    assert variable_at(dictionary, 0x6411, 5) is None  # the library would make one up
    assert variable_at(dictionary, 0x1001, 1) is None
    assert variable_at(dictionary, 0x1234, 0) is None
    with pytest.raises(DictionaryError, match=r"^EDS: 0x6411:05 has no DefaultValue; give it one$"):
        default_value(dictionary, 0x6411, 5)
