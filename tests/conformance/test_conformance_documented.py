"""What python-canopen's documentation shows, as it stands there, against the cards over every link."""

import io

import pytest
from canopen.sdo import SdoClient

from canarm_protocol.canopen.dictionary import eds_text
from canarm_protocol.clock import Clock

DAC, LATCH, ADC = 0x12, 0x13, 0x14
RESETS = 20


def test_a_reset_and_the_wait_for_its_boot_up_are_two_lines(link) -> None:
    """doc/nmt.rst: `node.nmt.state = "RESET"; node.nmt.wait_for_bootup(10)`. The wait begins after the command."""
    if link.clock is Clock.SYNC:
        pytest.skip("in lockstep cards boot in the same instant: hold `node.nmt.state_update` (docs/own-master.md)")
    node = link.card(DAC)
    for _ in range(RESETS):
        node.nmt.state = "RESET"
        node.nmt.wait_for_bootup(10)
    assert node.nmt.state == "PRE-OPERATIONAL"


def test_a_node_is_added_with_the_eds_that_it_holds(link, monkeypatch) -> None:
    """doc/network.rst: `network.add_node(6, upload_eds=True)`, and waits for 0.3 s, less than it takes when busy."""
    monkeypatch.setattr(SdoClient, "RESPONSE_TIMEOUT", 60.0)
    node = link.network.add_node(LATCH, upload_eds=True)
    assert node.object_dictionary is not None
    assert node.object_dictionary.device_information.product_name == "SC300 direction latch"
    assert node.sdo["Manufacturer device name"].raw == "SC300 direction latch"


def test_an_object_is_read_in_blocks(link) -> None:
    """doc/sdo.rst: `node.sdo[0x1021].open("r", encoding="ascii", block_transfer=True)`."""
    node = link.card(ADC)
    with node.sdo[0x1021].open("r", encoding="ascii", block_transfer=True) as file:
        assert file.read() == io.StringIO(eds_text("adc0809")).read()


def test_an_object_is_written_in_blocks(link) -> None:
    """doc/sdo.rst: `node.sdo[...].open("wb", size=..., block_transfer=True)`."""
    node = link.card(DAC)
    with node.sdo[0x6444][1].open("wb", size=4, block_transfer=True) as file:
        file.write(b"\0\0\0\x22")
    assert node.sdo[0x6444][1].raw == 0x2200_0000


def test_a_node_is_guarded(link) -> None:
    """doc/nmt.rst: `node.nmt.start_node_guarding(period)` sends remote frames with the COB-ID of the heartbeat."""
    link.send(0x700 + DAC, remote=True)
    link.send(0x700 + DAC, remote=True)
    assert link.await_frames(0x700 + DAC, 2) == [b"\x7f", b"\xff"]
