"""A cell as files for other tools: data sheets (EDS), configurations (DCF, `dcfgen`), CAN databases (DBC).

The functions return texts by file name; the caller writes them.
"""

from ..canopen.dictionary import IDENTITY, SYNC_OVERFLOW, default_value, eds_text
from ..canopen.eds_file import Commissioning, DeviceText, dcf_of, eds_of
from .bench_objects import bench_dictionary
from .cell_dbc import BENCH_BUS, ROBOT_BUS, bench_database, robot_database
from .configuration import card_settings, final_values
from .dbc_file import dbc_text
from .dcfgen_file import dcfgen_text
from .model import Cell
from .wiring import CardNode, card_nodes

BUSES = (ROBOT_BUS, BENCH_BUS)


def export_eds(cell: Cell) -> dict[str, str]:
    """The EDS of every card model in the cell, as its maker ships it, and of the bench node."""
    texts = {f"{model}.eds": eds_text(model) for model in sorted({card.model for card in cell.card})}
    bench = DeviceText(f"{cell.name}_bench.eds", "canarm test bench", "BENCH", f"Test bench of the cell {cell.name}")
    return {**texts, bench.file_name: eds_of(bench_dictionary(cell), bench)}


def export_dcf(cell: Cell) -> dict[str, str]:
    """The DCF of every card: node-ID, bit rate, and all that our own master sets, with PDOs of the wired channels.

    0x1019 is left out: a DCF is loaded in order of index, and a card refuses to change 0x1019 once 0x1006 is set.
    """
    return dict(_dcf(cell, node) for node in card_nodes(cell))


def export_dbc(cell: Cell) -> dict[str, str]:
    """The DBC of each of `BUSES`, in that order."""
    databases = (robot_database(cell), bench_database(cell))
    return {f"{database.name}.dbc": dbc_text(database) for database in databases}


def export_dcfgen(cell: Cell) -> dict[str, str]:
    """The bus description for Lely's `dcfgen`, and the EDS of every card model, which it names."""
    sheets = {f"{model}.eds": eds_text(model) for model in sorted({card.model for card in cell.card})}
    return {"bus.yml": dcfgen_text(cell, card_nodes(cell)), **sheets}


def _dcf(cell: Cell, node: CardNode) -> tuple[str, str]:
    card = node.card
    commissioning = Commissioning(
        file_name=f"{cell.name}_{card.name}.dcf",
        node_id=card.node_id,
        node_name=card.name,
        bitrate=cell.bus.bitrate,
        network_name=cell.name,
        serial_number=default_value(node.dictionary, IDENTITY, 4),
    )
    values = final_values(each for each in card_settings(node, cell.bus) if each.index != SYNC_OVERFLOW)
    return commissioning.file_name, dcf_of(eds_text(card.model), commissioning, values)
