"""What a cell says of its two buses: names, dictionaries, PDOs with the signals that its wiring gives them."""

from dataclasses import replace

from ..canopen.dictionary import default_value
from ..canopen.pdo import read_layouts
from ..cell.bench_objects import SDO_CHANNELS, bench_dictionary, sdo_channel
from ..cell.cell_dbc import BENCH, CONTROLLER, bench_database, wired_signal
from ..cell.model import Cell
from ..cell.wiring import card_nodes, wired_signals
from .book import Book
from .sdo_texts import SdoWay
from .signals import SignalMessage


def robot_book(cell: Cell) -> Book:
    """The robot's bus: controller and cards."""
    book = Book()
    book.names[cell.bus.controller_node_id] = CONTROLLER
    for node in card_nodes(cell):
        book.names[node.card.node_id] = node.card.name
        book.dictionaries[node.card.node_id] = node.dictionary
        for layout in (*node.rpdos, *node.tpdos):
            title = f"{layout.kind.upper()}{layout.number} of {node.card.name}"
            signals = tuple(
                replace(wired_signal(wired, name, cell.joints[wired.joint]), name=f"{name}.{wired.leaf}")
                for wired in wired_signals(cell, node, layout)
                for name in (cell.joint_names[wired.joint],)
            )
            book.messages[layout.cob_id, False] = SignalMessage(title, layout.size, signals)
    return book


def bench_book(cell: Cell) -> Book:
    """The bench bus: the bench node, its SDO channels, what the controller reports to it."""
    book, dictionary, node_id = Book(), bench_dictionary(cell), cell.bus.bench_node_id
    book.names |= {cell.bus.controller_node_id: CONTROLLER, node_id: BENCH}
    book.dictionaries[node_id] = dictionary
    described = {message.can_id: message for message in bench_database(cell).messages}
    for kind in ("rpdo", "tpdo"):
        for layout in read_layouts(dictionary, kind, lambda *where: default_value(dictionary, *where)):
            title = f"{layout.kind.upper()}{layout.number} of {BENCH}"
            book.messages[layout.cob_id, False] = SignalMessage(title, layout.size, described[layout.cob_id].signals)
    for channel in range(1, SDO_CHANNELS + 1):
        request, answer = sdo_channel(node_id, channel)
        book.channels[request] = SdoWay(node_id, True, channel)
        book.channels[answer] = SdoWay(node_id, False, channel)
    return book
