"""EDS and DBC files in decoding: the files that this project writes and that others read, and files that lie.

Expected values come from the stock `canopen` library and from cantools, and from CiA 301's layout.
"""

import struct

import canopen
import cantools
import pytest

from canarm_protocol.canopen.dictionary import eds_text
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.export import export_dbc, export_dcf
from canarm_protocol.decoding import Book, Decoder
from canarm_protocol.decoding.dbc_files import DatabaseError, load_databases
from canarm_protocol.decoding.eds_files import DataSheet
from canarm_protocol.errors import DictionaryError

DEVICE = """\
[FileInfo]
FileName=drive.eds
[DeviceInfo]
ProductName=\x1b[31mDrive[/red]
[MandatoryObjects]
SupportedObjects=1
1=0x1000
[1000]
ParameterName=Device type
DataType=0x0007
AccessType=ro
DefaultValue=0
[1800]
ParameterName=TPDO
ObjectType=0x9
SubNumber=2
[1800sub0]
ParameterName=Highest
DataType=0x0005
AccessType=ro
DefaultValue=2
[1800sub1]
ParameterName=COB-ID
DataType=0x0007
AccessType=rw
DefaultValue=$NODEID+0x180
[1A00]
ParameterName=Mapping
ObjectType=0x9
SubNumber=4
[1A00sub0]
ParameterName=Highest
DataType=0x0005
AccessType=rw
DefaultValue=4
[1A00sub1]
ParameterName=1
DataType=0x0007
AccessType=rw
DefaultValue=0x60410004
[1A00sub2]
ParameterName=2
DataType=0x0007
AccessType=rw
DefaultValue=0x00050004
[1A00sub3]
ParameterName=3
DataType=0x0007
AccessType=rw
DefaultValue=0x60640020
[1A00sub4]
ParameterName=4
DataType=0x0007
AccessType=rw
DefaultValue=0x77770008
[6041]
ParameterName=Status
DataType=0x0005
AccessType=ro
PDOMapping=1
[6064]
ParameterName=Position
DataType=0x0004
AccessType=ro
PDOMapping=1
"""


@pytest.fixture
def sheet(tmp_path):
    path = tmp_path / "drive.eds"
    path.write_text(DEVICE, encoding="utf-8")
    return DataSheet.load(path)


def test_a_foreign_device_is_decoded_by_its_mapping_with_bits_dummies_and_unknown_objects(sheet):
    """4 bits of status, 4 dummy bits, 32 bits of position, 8 of an object that the file does not describe."""
    book = Book()
    sheet.enter(book, 5)
    data = bytes([0xA7]) + struct.pack("<i", -1234) + b"\x2a"
    found = Decoder(book).meaning(Frame(0x185, data))
    assert [(field.name, field.text, field.start_bit, field.bit_length) for field in found.fields] == [
        ("Status", "7", 0, 4), ("Position", "-1234", 8, 32), ("0x7777:00", "42", 40, 8)
    ]  # fmt: skip
    assert "\x1b" not in str(found)
    assert str(Decoder(book).meaning(Frame(0x185, b"\x00"))).endswith("malformed: 1 bytes instead of 6")


def test_one_data_sheet_serves_every_node_that_nobody_else_describes(sheet):
    book = Book()
    book.describe_others = sheet.enter
    decoder = Decoder(book)
    for node_id in (1, 77, 127):
        assert decoder.meaning(Frame(0x180 + node_id, bytes(6))).fields[1].name == "Position"
    assert decoder.meaning(Frame(0x180, bytes(6))).fields == ()


def test_a_dcf_is_for_its_own_node_and_has_its_own_mapping(tmp_path):
    """The DCF of the ADC: TPDO2 is mapped to wired channels, which its data sheet does not say."""
    cell = load_cell("konkuk1")
    text = next(text for name, text in export_dcf(cell).items() if "adc" in name)
    path = tmp_path / "adc.dcf"
    path.write_text(text, encoding="ascii")
    sheet = DataSheet.load(path)
    assert sheet.node_id == 0x14
    book = Book()
    sheet.enter(book, 0x14)
    found = Decoder(book).meaning(Frame(0x394, struct.pack("<hh", 0x1300, 0)))
    assert [(field.name, field.text) for field in found.fields] == [
        ("Analogue input 5", "4864"), ("Analogue input 6", "0")
    ]  # fmt: skip


def test_the_cards_own_sheets_name_objects_as_the_stock_library_does(tmp_path):
    path = tmp_path / "adc.eds"
    path.write_text(eds_text("adc0809"), encoding="ascii")
    known = canopen.import_od(str(path), 0x14)
    dictionary = DataSheet.load(path).dictionary(0x14)
    assert {index: entry.name for index, entry in dictionary.items()} == {
        index: entry.name for index, entry in known.items()
    }


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "describes no object"),
        ("hello", "cannot be read as an EDS"),
        ("[1000]\nParameterName=a\n", "cannot be read as an EDS"),
        ("[6000]\nParameterName=a\nObjectType=8\nCompactSubObj=99999\n[6000Name]\nNrOfEntries=4000000000\n", "254"),
    ],
)
def test_a_file_that_is_no_data_sheet_is_refused_in_one_line(tmp_path, text, said):
    path = tmp_path / "a.eds"
    path.write_text(text)
    with pytest.raises(DictionaryError, match=said) as error:
        DataSheet.load(path)
    assert len(str(error.value).splitlines()) == 1
    assert "a.eds" in str(error.value)


def test_a_folder_is_no_file_and_an_eds_file_has_its_article(tmp_path):
    with pytest.raises(DictionaryError, match=r"is no regular file; a data sheet is an EDS file$"):
        DataSheet.load(tmp_path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DictionaryError, match=r"none.eds: No such file or directory; name an EDS or DCF file"):
        DataSheet.load(tmp_path / "none.eds")
    with pytest.raises(DatabaseError, match=r"none.dbc: No such file or directory; name a DBC file"):
        load_databases(Book(), tmp_path / "none.dbc")


def test_a_database_decodes_as_cantools_does(tmp_path):
    """The DBC of the robot's bus, decoded by the reader and by cantools itself."""
    text = next(iter(export_dbc(load_cell("konkuk1")).values()))
    path = tmp_path / "can0.dbc"
    path.write_text(text, encoding="ascii")
    book = Book()
    assert load_databases(book, path) == len(cantools.database.load_string(text).messages)
    data = bytes.fromhex("00490040803F803F")
    expected = cantools.database.load_string(text).decode_message(0x294, data)
    found = Decoder(book).meaning(Frame(0x294, data))
    assert found.title == "adc_TPDO2"
    assert {field.name: float(field.text.split()[0]) for field in found.fields} == pytest.approx(expected, abs=1e-3)


MULTIPLEXED = """\
VERSION ""
NS_ :
BS_:
BU_: ecu
BO_ 2566844926 Engine: 8 ecu
 SG_ page M : 7|8@0+ (1,0) [0|255] "" ecu
 SG_ speed m1 : 15|16@0+ (0.125,0) [0|8031.875] "rpm" ecu
 SG_ mode m2 : 8|2@1+ (1,0) [0|3] "" ecu
VAL_ 2566844926 mode 1 "on" 0 "off" ;
"""


def test_multiplexed_big_endian_extended_messages_are_decoded(tmp_path):
    """SPN 190 of J1939, engine speed, 0.125 rpm a bit, here big-endian and on page 1."""
    path = tmp_path / "engine.dbc"
    path.write_text(MULTIPLEXED)
    book = Book()
    load_databases(book, path)
    decoder, can_id = Decoder(book), 2566844926 & 0x1FFFFFFF
    found = decoder.meaning(Frame(can_id, bytes([1, 0x1F, 0x40, 0, 0, 0, 0, 0]), True))
    assert [(field.name, field.text) for field in found.fields] == [("page", "1"), ("speed", "1000.0 rpm")]
    assert found.fields[1].bits[:8] == (15, 14, 13, 12, 11, 10, 9, 8)
    found = decoder.meaning(Frame(can_id, bytes([2, 1, 0, 0, 0, 0, 0, 0]), True))
    assert [(field.name, field.text) for field in found.fields] == [("page", "2"), ("mode", "on")]
    assert decoder.meaning(Frame(can_id, bytes([2]), True)).is_wrong
    assert decoder.meaning(Frame(can_id, bytes([9]) + bytes(7), True)).is_wrong


@pytest.mark.parametrize("text", ["", "BO_ nonsense", "\x00\x01"])
def test_a_file_that_is_no_database_is_refused_in_one_line(tmp_path, text):
    path = tmp_path / "a.dbc"
    path.write_text(text)
    with pytest.raises(DatabaseError) as error:
        load_databases(Book(), path)
    assert len(str(error.value).splitlines()) == 1
    assert "a.dbc" in str(error.value)
