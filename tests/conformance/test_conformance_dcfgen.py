"""Lely's way to set up the cards: `dcfgen` makes the files of its master from what `canarm export dcfgen` writes.

Lely's master resets a node and downloads the objects of a concise DCF, in its order (CiA 302-2, 0x1F22). That is done
here over every link, with the files that `dcfgen` itself makes.
"""

import importlib
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from dcf import Device

from canarm_protocol.canopen.dictionary import variable_at
from canarm_protocol.cell.cell_file import load_cell, parse_cell, shipped_cells
from canarm_protocol.cell.configuration import card_settings, final_values
from canarm_protocol.cell.export import export_dcfgen
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import card_nodes

CELL = load_cell("konkuk1")
NODES = {node.card.name: node for node in card_nodes(CELL)}


def dcfgen(cell: Cell, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run `dcfgen -r bus.yml` on the exported files.

    dcf-tools 2.4.2 finds its template by `pkg_resources`, which setuptools 82 no longer has.
    """
    for name, text in export_dcfgen(cell).items():
        (folder / name).write_text(text, encoding="ascii")
    finder = SimpleNamespace(
        resource_filename=lambda module, name: str(Path(sys.modules[module].__file__).parent / name)
    )
    monkeypatch.setitem(sys.modules, "pkg_resources", finder)
    monkeypatch.setattr(sys, "argv", ["dcfgen", "-r", "bus.yml"])
    monkeypatch.chdir(folder)
    importlib.import_module("dcfgen.cli").main()


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder where `dcfgen` has made its files of konkuk1."""
    dcfgen(CELL, tmp_path, monkeypatch)
    return tmp_path


def downloads(file: Path) -> Iterator[tuple[int, int, bytes]]:
    """Index, sub-index and data of a concise DCF: a count, then index, sub-index, size and data of each (CiA 302-2)."""
    content = file.read_bytes()
    (count,), place = struct.unpack_from("<I", content), 4
    for _ in range(count):
        index, subindex, size = struct.unpack_from("<HBI", content, place)
        place += 7 + size
        yield index, subindex, content[place - size : place]
    assert place == len(content)


def download(link, node_id: int, index: int, subindex: int, data: bytes) -> None:
    """One expedited SDO (CiA 301, 7.2.4.3.3); the card must take it."""
    multiplexor = struct.pack("<HB", index, subindex)
    request = bytes((0x23 | (4 - len(data)) << 2,)) + multiplexor + data.ljust(4, b"\0")
    assert link.exchange(node_id, request.hex()) == (b"\x60" + multiplexor + bytes(4)).hex()


def read(link, node_id: int, index: int, subindex: int, size: int) -> int:
    answer = bytes.fromhex(link.exchange(node_id, (b"\x40" + struct.pack("<HB", index, subindex) + bytes(4)).hex()))
    assert answer[0] == 0x43 | (4 - size) << 2, answer.hex()
    return int.from_bytes(answer[4 : 4 + size], "little")


@pytest.mark.parametrize("name", NODES)
def test_lelys_master_sets_what_our_own_sets(link, made: Path, name: str) -> None:
    node = NODES[name]
    node_id = node.card.node_id
    for index, subindex, data in downloads(made / f"{name}.bin"):
        download(link, node_id, index, subindex, data)
    wanted = final_values(card_settings(node, CELL.bus))
    # 0x1019 is the counter of our SYNC, which Lely's has not; 0x1006 and 0x1007 change nothing without it.
    for index in (0x1006, 0x1007, 0x1019):
        wanted.pop((index, 0), None)
    found = {
        (index, subindex): read(link, node_id, index, subindex, len(variable_at(node.dictionary, index, subindex)) // 8)
        for index, subindex in wanted
    }
    assert found == wanted


def test_lelys_master_exchanges_the_pdos_of_the_wired_channels(made: Path) -> None:
    master = Device.from_dcf(str(made / "master.dcf"))
    sent = {pdo.cob_id for pdo in master.tpdo.values() if not pdo.cob_id >> 31}
    received = {pdo.cob_id for pdo in master.rpdo.values() if not pdo.cob_id >> 31}
    assert sent == {0x312, 0x213}
    assert received == {0x294, 0x394}
    assert master[0x1006][0].parse_value() == 2500
    assert master[0x1017][0].parse_value() == 20
    assert master[0x1019][0].parse_value() == 0


@pytest.mark.parametrize("name", shipped_cells())
def test_lelys_master_is_the_other_end_of_every_pdo(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where a card has a PDO without a wired channel, as in rhino-pair: that is switched off."""
    cell = load_cell(name)
    dcfgen(cell, tmp_path, monkeypatch)
    master = Device.from_dcf(str(tmp_path / "master.dcf"))
    nodes = card_nodes(cell)
    assert {pdo.cob_id for pdo in master.tpdo.values()} == {each.cob_id for node in nodes for each in node.rpdos}
    assert {pdo.cob_id for pdo in master.rpdo.values()} == {each.cob_id for node in nodes for each in node.tpdos}
    for node in nodes:
        switched_off = {(i, s) for i, s, data in downloads(tmp_path / f"{node.card.name}.bin") if data[-1:] == b"\x80"}
        assert {(0x1800 + each.number - 1, 1) for each in node.unused} <= switched_off


def test_a_card_may_be_called_master(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = shipped_cells()["konkuk1"]
    assert text.count('name = "dac"') == 1
    dcfgen(parse_cell(text.replace('name = "dac"', 'name = "master"'), "cell.toml"), tmp_path, monkeypatch)
    assert list(downloads(tmp_path / "master_card.bin"))
