"""Data sheets and configurations of a cell, judged by other people's CANopen tools; the `export` command."""

import io
import re
import subprocess
import sys
import warnings
from configparser import RawConfigParser
from pathlib import Path

import can
import canopen
import pytest
from canopen.objectdictionary import ODVariable
from cyclopts import App, CycloptsError
from dcf import Device

from canarm import Rig
from canarm.commands.export import export
from canarm.options import CellOptions
from canarm.usage import UsageError
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.bench_objects import bench_dictionary
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.export import export_dcf, export_dcfgen, export_eds
from canarm_protocol.clock import Clock
from canarm_protocol.errors import CellError

CELL = load_cell("konkuk1")
EDS, DCF, DCFGEN = export_eds(CELL), export_dcf(CELL), export_dcfgen(CELL)
NODE_IDS = {"konkuk1_dac.dcf": 0x12, "konkuk1_latch.dcf": 0x13, "konkuk1_adc.dcf": 0x14}
EVERY_FILE = pytest.mark.parametrize(("name", "text"), [*EDS.items(), *DCF.items()], ids=[*EDS, *DCF])

# CiA 306-1, 4.4 and 4.5: the keys that a data sheet has to have.
FILE_INFO = """
FileName FileVersion FileRevision EDSVersion Description
CreationTime CreationDate CreatedBy ModificationTime ModificationDate ModifiedBy
"""
DEVICE_INFO = """
VendorName VendorNumber ProductName ProductNumber RevisionNumber OrderCode
BaudRate_10 BaudRate_20 BaudRate_50 BaudRate_125 BaudRate_250 BaudRate_500 BaudRate_800 BaudRate_1000
SimpleBootUpMaster SimpleBootUpSlave Granularity DynamicChannelsSupported GroupMessaging
NrOfRXPDO NrOfTXPDO LSS_Supported
"""
ARRAYS_OF_CIA_301 = {0x1003, 0x1010, 0x1011, 0x1016, 0x1029}
RECORDS_OF_CIA_301 = {0x1018, *range(0x1200, 0x1280), *range(0x1400, 0x1C00)}


def parsed(text: str) -> RawConfigParser:
    parser = RawConfigParser(strict=True)
    parser.optionxform = str
    parser.read_string(text)
    return parser


def imported(name: str, text: str, node_id: int | None = None) -> canopen.ObjectDictionary:
    source = io.StringIO(text)
    source.name = name
    return canopen.import_od(source, node_id)


def variables(dictionary: canopen.ObjectDictionary) -> dict[tuple[int, int], ODVariable]:
    found = {}
    for index, entry in dictionary.items():
        for member in [entry] if isinstance(entry, ODVariable) else entry.subindices.values():
            found[index, member.subindex] = member
    return found


@EVERY_FILE
def test_the_checker_of_lely_core_finds_nothing_to_say(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text, encoding="ascii")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Device.from_dcf(str(tmp_path / name), {"NODEID": 18} if name.endswith(".eds") else {})


@EVERY_FILE
def test_no_section_or_key_of_cia_306_is_missing(name: str, text: str) -> None:
    sections = parsed(text)
    assert set(FILE_INFO.split()) <= set(sections["FileInfo"])
    assert set(DEVICE_INFO.split()) == set(sections["DeviceInfo"])
    assert [sections["DummyUsage"][f"Dummy000{number}"] for number in range(1, 8)] == ["0"] * 7
    assert int(sections["Comments"]["Lines"]) == len(sections["Comments"]) - 1 >= 1
    assert sections["FileInfo"]["FileName"] == name
    assert re.fullmatch(r"(0\d|1[0-2]):[0-5]\d(AM|PM)", sections["FileInfo"]["CreationTime"])
    assert re.fullmatch(r"(0\d|1[0-2])-[0-3]\d-\d{4}", sections["FileInfo"]["CreationDate"])


@EVERY_FILE
def test_the_object_lists_name_exactly_the_objects_that_are_there(name: str, text: str) -> None:
    sections = parsed(text)
    listed: list[int] = []
    for title, belongs in {
        "MandatoryObjects": lambda index: index in (0x1000, 0x1001, 0x1018),
        "OptionalObjects": lambda index: 0x1000 <= index < 0x2000 or index >= 0x6000,
        "ManufacturerObjects": lambda index: 0x2000 <= index < 0x6000,
    }.items():
        indices = [int(sections[title][str(place)], 0) for place in range(1, len(sections[title]))]
        assert int(sections[title]["SupportedObjects"]) == len(indices)
        assert all(map(belongs, indices))
        listed += indices
    assert {0x1000, 0x1001, 0x1018} <= set(listed)
    present = [int(title, 16) for title in sections.sections() if re.fullmatch("[0-9A-F]{4}", title)]
    assert sorted(listed) == sorted(present)


@EVERY_FILE
def test_every_object_is_described_in_full(name: str, text: str) -> None:
    sections = parsed(text)
    members: dict[str, int] = {}
    for title in sections.sections():
        match = re.fullmatch("([0-9A-F]{4})(sub[0-9A-F]{1,2})?", title)
        if match is None:
            continue
        entries = sections[title]
        index, is_member = int(match[1], 16), match[2] is not None
        object_type = int(entries["ObjectType"], 0)
        assert entries["ParameterName"]
        if object_type in (0x8, 0x9) and not is_member:
            assert index not in (RECORDS_OF_CIA_301 if object_type == 0x8 else ARRAYS_OF_CIA_301)
            assert set(entries) == {"ParameterName", "ObjectType", "SubNumber"}
            members[match[1]] = int(entries["SubNumber"], 0)
            continue
        if object_type == 0x2:  # a DOMAIN, CiA 306: it has no value of its own
            assert int(entries["DataType"], 0) == 0xF
            assert entries["AccessType"] in ("ro", "wo", "rw")
            continue
        assert object_type == 0x7
        assert int(entries["DataType"], 0) in {*range(0x1, 0xC), 0xF, *range(0x10, 0x1C)}
        assert entries["AccessType"] in ("ro", "wo", "rw", "rwr", "rww", "const")
        assert entries["PDOMapping"] in ("0", "1")
        assert "DefaultValue" in entries
        if is_member:
            members[match[1]] -= 1
    assert members
    assert set(members.values()) == {0}


@EVERY_FILE
def test_line_ends_are_the_same_throughout_and_every_character_is_ascii(name: str, text: str) -> None:
    assert "\r" not in text
    assert text.endswith("\n")
    assert text.isascii()


@EVERY_FILE
def test_the_number_of_pdos_is_that_of_their_parameters(name: str, text: str) -> None:
    sections = parsed(text)
    for key, bases in {"NrOfRXPDO": ("14", "16"), "NrOfTXPDO": ("18", "1A")}.items():
        for base in bases:
            count = sum(bool(re.fullmatch(f"{base}[0-9A-F]{{2}}", title)) for title in sections.sections())
            assert int(sections["DeviceInfo"][key]) == count


def test_every_card_model_of_the_cell_has_its_data_sheet_and_the_bench_too() -> None:
    assert set(EDS) == {"dac0808.eds", "sc300.eds", "adc0809.eds", "konkuk1_bench.eds"}


def test_the_bench_reads_back_as_the_dictionary_it_was_written_from() -> None:
    written = variables(bench_dictionary(CELL))
    read = variables(imported("bench.eds", EDS["konkuk1_bench.eds"], CELL.bus.bench_node_id))
    assert read.keys() == written.keys()
    for key, variable in written.items():
        for trait in ("name", "data_type", "access_type", "pdo_mappable", "default", "min", "max"):
            assert getattr(read[key], trait) == getattr(variable, trait), (key, trait)


@pytest.mark.parametrize(("name", "node_id"), NODE_IDS.items())
def test_a_configuration_names_its_node_its_bit_rate_and_its_data_sheet(name: str, node_id: int) -> None:
    sections = parsed(DCF[name])
    dictionary = imported(name, DCF[name])
    assert (dictionary.node_id, dictionary.bitrate) == (node_id, 1_000_000)
    assert sections["FileInfo"]["LastEDS"] in EDS
    assert sections["DeviceComissioning"]["NodeName"] == name.removeprefix("konkuk1_").removesuffix(".dcf")


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export") / "run"
    with Rig("konkuk1", law="pd", seed=1, out=folder) as rig:
        rig.run(seconds=0.05)
    return folder


def test_a_configuration_holds_what_our_own_master_leaves_in_the_card(run_folder: Path) -> None:
    written: dict[tuple[int, int, int], int] = {}
    with can.CanutilsLogReader(run_folder / "can0.log") as log:
        for message in log:
            command, data = message.data[:1], message.data
            if 0x600 < message.arbitration_id < 0x680 and command and command[0] & 0xE3 == 0x23:
                size = 4 - (command[0] >> 2 & 0x3)  # CiA 301, 7.2.4.3.3: expedited download
                value = int.from_bytes(data[4 : 4 + size], "little")
                written[message.arbitration_id - 0x600, int.from_bytes(data[1:3], "little"), data[3]] = value
    configured = {
        (NODE_IDS[name], *key): variable.value
        for name, text in DCF.items()
        for key, variable in variables(imported(name, text)).items()
        if variable.value is not None
    }
    # 0x1019 is in no DCF: loaded from the lowest index up, it would come after 0x1006, which fixes it (7.5.2.22).
    counters = {key: written.pop(key) for key in tuple(written) if key[1] == 0x1019}
    assert counters == dict.fromkeys([(0x12, 0x1019, 0), (0x13, 0x1019, 0), (0x14, 0x1019, 0)], 240)
    assert configured == written


def test_only_wired_channels_are_mapped() -> None:
    dictionary = imported("adc.dcf", DCF["konkuk1_adc.dcf"])
    assert dictionary[0x1A01][0].value == 4
    assert dictionary[0x1A02][0].value == 2
    assert [dictionary[0x1A02][place].value for place in (1, 2)] == [0x64010510, 0x64010610]


class EmulatedBus(canopen.Network):
    """The robot's bus as the `canopen` library sees it: what it sends reaches the bench at once."""

    def __init__(self) -> None:
        super().__init__()
        self.bench = FaultBench(CELL, Truth.from_settings(CELL, {}), Clock.SYNC, 0)
        self.bench.start()
        self.bench.records.clear()

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self.bench.receive(Frame(can_id, bytes(data)), self)
        records, self.bench.records = self.bench.records, []
        for record in records:
            if record.origin is None:
                self.notify(record.frame.can_id, bytearray(record.frame.data), record.time_ns * 1e-9)


def test_a_foreign_master_drives_the_robot_by_the_configurations_alone() -> None:
    bus = EmulatedBus()
    nodes = {name: canopen.RemoteNode(None, imported(name, text)) for name, text in DCF.items()}
    for node in nodes.values():
        bus.add_node(node)
        node.load_configuration()
    bus.nmt.state = "OPERATIONAL"
    dac, latch, adc = nodes["konkuk1_dac.dcf"], nodes["konkuk1_latch.dcf"], nodes["konkuk1_adc.dcf"]
    dac.rpdo.read(from_od=True)
    latch.rpdo.read(from_od=True)
    adc.tpdo.read(from_od=True)
    adc.tpdo.subscribe()
    dac.rpdo[2][0].raw = 102 << 7  # 102/255 of 1.5 A = 0.6 A at joint2
    latch.rpdo[1][0].raw = 0b10  # counter-clockwise
    for counter in range(1, 81):
        if counter % 8 == 1:
            bus.send_message(0x701, b"\x05")  # heartbeat of node 1, every 20 ms; the cards wait 100 ms for it
        dac.rpdo[2].transmit()
        latch.rpdo[1].transmit()
        bus.send_message(0x080, bytes((counter,)))
    truth = bus.bench.world.state()[0]
    assert truth.command_a == pytest.approx(0.6)
    assert truth.angle_rad > 0.36  # 20 degrees at the start
    position, current = adc.tpdo[2][0].raw / 128, adc.tpdo[3][0].raw / 128
    assert (position - 127.5) * 270 / 255 == pytest.approx(truth.angle_rad * 57.29578, abs=3.0)
    assert current * 1.5 / 255 == pytest.approx(truth.current_a, abs=0.03)


@pytest.mark.parametrize("kind", ["eds", "dcf", "dcfgen", "dbc"])
def test_the_same_cell_gives_the_same_bytes_in_every_process(kind: str) -> None:
    program = (
        "import hashlib; from canarm_protocol.cell.cell_file import load_cell; "
        f"from canarm_protocol.cell.export import export_{kind} as export; "
        "print(hashlib.sha256(repr(export(load_cell('konkuk1'))).encode()).hexdigest())"
    )
    digests = {
        subprocess.run(
            [sys.executable, "-c", program], env={"PYTHONHASHSEED": seed}, check=True, capture_output=True, timeout=120
        ).stdout
        for seed in ("1", "2")
    }
    assert len(digests) == 1


@pytest.mark.parametrize(("kind", "texts"), [("eds", EDS), ("dcf", DCF), ("dcfgen", DCFGEN)])
def test_the_command_writes_a_file_each_and_says_which(
    kind: str, texts: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new" / "folder"
    assert export(kind, out=folder) == 0
    assert {path.name: path.read_bytes().decode("ascii") for path in folder.iterdir()} == texts
    assert set(capsys.readouterr().out.split()) == {str(folder / name) for name in texts}


def test_an_unknown_format_is_answered_with_the_ones_there_are() -> None:
    app = App(result_action="return_value")
    app.command(export)
    with pytest.raises(CycloptsError, match=r'"xml".*"eds", "dcf", "dcfgen", "dbc"'):
        app(["export", "xml"], exit_on_error=False, print_error=False)


@pytest.mark.parametrize("kind", ["eds", "dcf", "dcfgen"])
def test_several_files_need_a_folder(kind: str) -> None:
    with pytest.raises(UsageError, match=f"export {kind}: writes several files; name a folder with --out DIR"):
        export(kind)


def test_a_bus_can_be_chosen_for_a_dbc_only(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--bus can0: only a dbc"):
        export("eds", bus="can0", out=tmp_path)


def test_an_unknown_cell_is_named_with_the_ones_there_are(tmp_path: Path) -> None:
    with pytest.raises(CellError, match=r"nowhere: .*konkuk1"):
        export("eds", cell=CellOptions(cell="nowhere"), out=tmp_path)


def test_a_folder_that_cannot_be_written_is_named_in_one_line(tmp_path: Path) -> None:
    occupied = tmp_path / "file"
    occupied.write_text("")
    with pytest.raises(UsageError, match=r"--out .*file: is no folder and cannot become one: .+") as caught:
        export("eds", out=occupied)
    assert "\n" not in str(caught.value)
    (tmp_path / "dac0808.eds").mkdir()
    with pytest.raises(UsageError, match=r"dac0808\.eds cannot be written: .+"):
        export("eds", out=tmp_path)
