"""The bench node's dictionary and PDOs: complete for every joint, and no COB-ID twice on its bus."""

import configparser
import io

import canopen
import pytest

from canarm_protocol.canopen.dictionary import default_value
from canarm_protocol.canopen.pdo import read_layouts
from canarm_protocol.cell.bench_objects import (
    CLAIM_CHANNEL,
    CLIENT_CHANNELS,
    CONTROLLER_CHANNEL,
    SDO_CHANNELS,
    bench_dictionary,
    bench_pdos,
    sdo_channel,
)
from canarm_protocol.cell.cell_checks import BENCH_NODE_IDS, MOST_JOINTS
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.export import export_eds
from canarm_protocol.cell.model import Cell

CELL = load_cell("konkuk1")


def crowded(node_id: int) -> Cell:
    """A cell with as many joints as the bench node takes, and that node-ID."""
    joints = tuple(CELL.joints[0].model_copy(update={"name": f"j{number}"}) for number in range(MOST_JOINTS))
    robot = CELL.robot[0].model_copy(update={"joint": joints})
    return CELL.model_copy(update={"robot": (robot,), "bus": CELL.bus.model_copy(update={"bench_node_id": node_id})})


@pytest.mark.parametrize("node_id", [BENCH_NODE_IDS[0], BENCH_NODE_IDS[-1]])
def test_no_two_messages_of_the_bench_bus_share_a_cob_id(node_id: int) -> None:
    dictionary = bench_dictionary(crowded(node_id))
    taken = [0x000, 0x080, 0x100]
    taken += [base + each for each in (*range(1, 0x70), node_id) for base in (0x080, 0x700)]
    taken += [cob_id for channel in range(SDO_CHANNELS + 1) for cob_id in sdo_channel(node_id, channel)]
    for kind in ("rpdo", "tpdo"):
        taken += [
            layout.cob_id for layout in read_layouts(dictionary, kind, lambda i, s: default_value(dictionary, i, s))
        ]
    assert len(taken) == len(set(taken))
    assert max(taken) <= 0x77F


def test_every_pdo_carries_what_its_name_says() -> None:
    pdos = bench_pdos(CELL)

    def objects(layout: object) -> list[tuple[int, int]]:
        return [(mapped.index, mapped.subindex) for mapped in layout.objects]

    assert objects(pdos.status) == [(0x2001, 0)]
    assert [objects(layout) for layout in pdos.truth] == [[(0x2100, 1), (0x2101, 1)], [(0x2100, 2), (0x2101, 2)]]
    assert [objects(layout) for layout in pdos.drive] == [[(0x2102, 1), (0x2103, 1)], [(0x2102, 2), (0x2103, 2)]]
    assert objects(pdos.faults) == [(0x2405, 0), (0x2410, 0), (0x2406, 0), (0x2141, 0)]
    assert objects(pdos.detection) == [(0x2140, 0)]
    assert objects(pdos.controller) == [(0x2110, 0), (0x2111, 0), (0x2112, 0)]
    assert [objects(layout) for layout in pdos.reference] == [[(0x2110, 0), (0x2120, 1)], [(0x2110, 0), (0x2120, 2)]]
    assert [objects(layout) for layout in pdos.measured] == [[(0x2121, 1), (0x2122, 1)], [(0x2121, 2), (0x2122, 2)]]
    assert [objects(layout) for layout in pdos.command] == [[(0x2123, 1), (0x2124, 1)], [(0x2123, 2), (0x2124, 2)]]
    assert objects(pdos.internals[1][0]) == [(0x2131, 2), (0x2132, 2)]
    assert objects(pdos.internals[1][1]) == [(0x2133, 2), (0x2134, 2)]


def test_floats_travel_in_single_precision() -> None:
    layout = bench_pdos(CELL).truth[0]
    assert layout.pack(1.0, -2.0).hex() == "0000803f" + "000000c0"  # IEEE 754
    assert layout.size == 8


def test_defaults_fit_their_types_and_every_array_tells_its_length() -> None:
    for entry in bench_dictionary(CELL).values():
        if isinstance(entry, canopen.objectdictionary.ODVariable):
            continue
        assert entry.index == 0x1003 or entry[0].default == max(entry.subindices)
        for variable in entry.values():
            variable.encode_raw(variable.default)


def test_sdo_channels_are_the_default_one_and_nine_more() -> None:
    assert sdo_channel(0x70, 0) == (0x670, 0x5F0)
    assert [sdo_channel(0x70, n) for n in (1, 9)] == [(0x631, 0x5B1), (0x639, 0x5B9)]
    dictionary = bench_dictionary(CELL)
    for channel in range(SDO_CHANNELS + 1):
        record = 0x1200 + channel
        assert (default_value(dictionary, record, 1), default_value(dictionary, record, 2)) == sdo_channel(
            0x70, channel
        )
    with pytest.raises(ValueError, match=r"^SDO channel 10: the bench has channels 0 to 9$"):
        sdo_channel(0x70, 10)


def test_clients_channels_are_neither_the_default_one_nor_the_controllers_nor_that_for_claims() -> None:
    assert sorted({0, CONTROLLER_CHANNEL, CLAIM_CHANNEL, *CLIENT_CHANNELS}) == list(range(SDO_CHANNELS + 1))
    assert len(CLIENT_CHANNELS) == SDO_CHANNELS - 2


def test_the_eds_describes_the_objects_of_faults_to_any_tool() -> None:
    eds = io.StringIO(export_eds(CELL)["konkuk1_bench.eds"])
    eds.name = "konkuk1_bench.eds"
    dictionary = canopen.import_od(eds, 0x70)
    domain, text, u8 = 0x000F, 0x0009, 0x0005  # CiA 301, table 44
    described = {index: (dictionary[index].data_type, dictionary[index].access_type) for index in range(0x2400, 0x2406)}
    assert described == {
        0x2400: (domain, "wo"),
        **dict.fromkeys(range(0x2401, 0x2405), (text, "ro")),
        0x2405: (u8, "ro"),
    }
    assert (dictionary[0x2410].data_type, dictionary[0x2410].access_type, dictionary[0x2410].max) == (u8, "rw", 1)


def sections() -> configparser.ConfigParser:
    text = export_eds(CELL)[f"{CELL.name}_bench.eds"]
    parser = configparser.ConfigParser(interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(text)
    return parser


def test_independent_readers_take_the_eds() -> None:
    """What two of them refused: PDOMapping where nothing can be mapped, and an error history that cannot be cleared."""
    parser = sections()
    domains = [name for name in parser.sections() if parser[name].get("DataType") == "0x000F"]
    assert domains
    assert not [name for name in domains if "PDOMapping" in parser[name]]
    assert parser["1003sub0"]["AccessType"] == "rw"  # CiA 301, 7.5.2.4: writing 0 clears it


def test_the_eds_says_which_channels_can_be_claimed() -> None:
    parser, channels = sections(), range(1, SDO_CHANNELS + 1)
    access = {channel: parser[f"2420sub{channel:X}"]["AccessType"] for channel in channels}
    assert [channel for channel, kind in access.items() if kind == "rw"] == list(CLIENT_CHANNELS)
