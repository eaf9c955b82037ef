"""The log pages put together from the bus are those that a controller writes down: its own image is the judge."""

import numpy as np
import pytest

from canarm import Rig
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Quantity
from canarm_protocol.runs.can_log import log_frames
from canarm_tui.bus.memory_mirror import SAMPLES, MemoryMirror, address_of

SECONDS = 2.0


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A recorded run of two joints."""
    folder = tmp_path_factory.mktemp("mirror") / "run"
    with Rig("konkuk1", law="pd", out=folder) as rig:
        rig.run(SECONDS)
    return folder


def image(run):
    return np.frombuffer((run / "memory.bin").read_bytes(), np.uint8)


def test_the_pages_are_at_the_addresses_of_the_papers_memory_map():
    """As `reference/memory.py` lists them."""
    assert [address_of(joint, Quantity.POSITION) for joint in (0, 1, 2)] == [0x4000, 0x5000, 0x4000]
    assert [address_of(joint, Quantity.VELOCITY, 4097) for joint in (0, 1)] == [0x6001, 0x7001]


def test_what_was_on_the_bus_makes_the_image_that_the_controller_wrote_down(run):
    mirror, written = MemoryMirror(load_cell("konkuk1")), image(run)
    mirror.receive(log_frames(run / "can0.log"))
    assert len(mirror.pages) == 4
    for page in mirror.pages:
        first = page.address - 0x2000
        known = page.is_known.copy()
        known[mirror.cycle % SAMPLES] = False  # the controller may stop before it writes the last one
        assert known.sum() >= SECONDS * 400 - 1
        np.testing.assert_array_equal(page.data[known], written[first : first + SAMPLES][known])


def test_with_the_image_of_a_run_its_torque_table_is_there_as_well(run):
    """The table's pages are at $2000 and $3000 of the bank, the log's as before; a new beginning leaves the image."""
    mirror, written = MemoryMirror(load_cell("konkuk1"), image(run).tobytes()), image(run)
    assert [page.address for page in mirror.pages] == [0x2000, 0x4000, 0x6000, 0x3000, 0x5000, 0x7000]
    mirror.receive([(0, Frame(0x000, b"\x01\x00")), (0, Frame(0x080, b"\x01")), (0, Frame(0x294, bytes(8)))])
    assert mirror.pages[1].data[0] == 0
    mirror.forget()
    for page in mirror.pages:
        assert page.is_known.all()
        np.testing.assert_array_equal(page.data, written[page.address - 0x2000 :][:SAMPLES])


def test_who_comes_later_finds_the_cycle_by_telemetry_and_the_counter_of_sync(run):
    """Telemetry that is up to a hundred cycles off tells the round of the counter, which tells the rest."""
    frames = list(log_frames(run / "can0.log"))
    syncs = [place for place, (_, frame) in enumerate(frames) if frame.can_id == 0x080]
    for wrong_by in (-100, 0, 100):
        mirror = MemoryMirror(load_cell("konkuk1"))
        mirror.anchor(600 + wrong_by)
        mirror.receive(frames[syncs[600] : syncs[700] + 1])
        assert mirror.cycle == 700
        first = mirror.pages[0].address - 0x2000
        np.testing.assert_array_equal(mirror.pages[0].data[600:700], image(run)[first + 600 : first + 700])


def test_a_missed_sync_makes_the_cycle_unknown_until_it_is_known_again():
    mirror = MemoryMirror(load_cell("konkuk1"))
    mirror.receive([(0, Frame(0x000, b"\x01\x00")), (0, Frame(0x080, b"\x01")), (0, Frame(0x080, b"\x02"))])
    assert mirror.cycle == 1
    mirror.receive([(0, Frame(0x080, b"\x07"))])
    assert mirror.cycle is None
    mirror.anchor(10)
    mirror.receive([(0, Frame(0x080, b"\x09"))])
    assert mirror.cycle == 8


def test_frames_that_are_too_short_and_others_change_nothing():
    mirror = MemoryMirror(load_cell("konkuk1"))
    mirror.receive([(0, Frame(0x000, b"\x01\x00")), (0, Frame(0x080, b"\x01"))])
    mirror.receive([(0, Frame(0x294, b"\x01")), (0, Frame(0x294, bytes(8), True)), (0, Frame(0x080, bytes(8)))])
    assert not any(page.is_known.any() for page in mirror.pages)
