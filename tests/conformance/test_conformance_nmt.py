"""NMT slave (CiA 301, 7.2.8 and 7.3.2): states, commands, boot-up, what is allowed in which state."""

import pytest

START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
DAC, LATCH, ADC = 0x12, 0x13, 0x14
STATE_OF = {START: 5, STOP: 4, PRE_OPERATIONAL: 127, RESET_NODE: 127, RESET_COMMUNICATION: 127}
UPLOAD_DEVICE_TYPE = "4000100000000000"


def state_of(link, node_id: int) -> int:
    """What the next heartbeat says, once all that was under way has come: another card has answered."""
    link.exchange(DAC if node_id == ADC else ADC, UPLOAD_DEVICE_TYPE)
    count = len(link.data(0x700 + node_id))
    return link.await_frames(0x700 + node_id, count + 1)[count][0]


@pytest.mark.parametrize("command", [RESET_NODE, RESET_COMMUNICATION])
@pytest.mark.parametrize("before", [START, STOP, PRE_OPERATIONAL])
def test_every_reset_boots_up_from_every_state_into_pre_operational(link, before: int, command: int) -> None:
    """7.3.2.2: initialisation ends with the boot-up message (7.2.8.3.3), then PRE-OPERATIONAL by itself."""
    link.nmt(before, DAC)
    link.nmt(command, DAC)
    assert link.await_frames(0x700 + DAC) == [b"\0"]
    link.card(DAC).sdo[0x1017].raw = 10
    assert state_of(link, DAC) == 127


@pytest.mark.parametrize("after", [START, STOP, PRE_OPERATIONAL])
@pytest.mark.parametrize("before", [START, STOP, PRE_OPERATIONAL])
def test_every_transition_between_the_states_shows_in_the_heartbeat(link, before: int, after: int) -> None:
    """7.2.8.3.1, 0x1017."""
    link.card(LATCH).sdo[0x1017].raw = 10
    for command in (before, after):
        link.nmt(command, LATCH)
        assert state_of(link, LATCH) == STATE_OF[command]


def test_a_command_reaches_the_node_that_it_names_and_0_reaches_all(link) -> None:
    """7.2.8.3.1: node-ID 0 addresses every node."""
    for node_id in (DAC, LATCH, ADC):
        link.card(node_id).sdo[0x1017].raw = 10
    link.nmt(START, ADC)
    assert [state_of(link, node_id) for node_id in (DAC, LATCH, ADC)] == [127, 127, 5]
    link.nmt(STOP)
    for node_id in (DAC, LATCH, ADC):  # none of them answers now
        link.until(lambda n=node_id: link.data(0x700 + n)[-1] == b"\x04", f"STOPPED of 0x{node_id:02X}")


def test_the_library_sees_boot_up_and_state(link) -> None:
    """python-canopen's NmtMaster: wait_for_bootup, state."""
    node = link.card(ADC)
    seen: list[int] = []
    node.nmt.add_heartbeat_callback(seen.append)
    node.nmt.state = "RESET"
    link.until(lambda: seen, "boot-up")
    node.sdo[0x1017].raw = 10
    node.nmt.state = "OPERATIONAL"
    link.until(lambda: 5 in seen, "heartbeat in OPERATIONAL")
    assert node.nmt.state == "OPERATIONAL"


def test_sdo_is_answered_in_every_state_but_stopped(link) -> None:
    """7.3.2.2.5, table 37."""
    for command in (PRE_OPERATIONAL, START):
        link.nmt(command, DAC)
        assert link.exchange(DAC, UPLOAD_DEVICE_TYPE).startswith("43001000")
    link.nmt(STOP, DAC)
    count = len(link.data(0x580 + DAC))
    link.send(0x600 + DAC, bytes.fromhex(UPLOAD_DEVICE_TYPE))
    link.exchange(ADC, UPLOAD_DEVICE_TYPE)  # what came before has been dealt with
    assert len(link.data(0x580 + DAC)) == count
    link.nmt(PRE_OPERATIONAL, DAC)
    assert link.exchange(DAC, UPLOAD_DEVICE_TYPE).startswith("43001000")


@pytest.mark.parametrize("command", [PRE_OPERATIONAL, STOP])
def test_pdos_are_exchanged_in_operational_only(link, command: int) -> None:
    """7.3.2.2.5, table 37."""
    link.nmt(START)
    link.cycle(0x394)
    link.nmt(command, ADC)
    link.nmt(command, DAC)
    link.exchange(LATCH, UPLOAD_DEVICE_TYPE)
    counts = len(link.data(0x294)), len(link.data(0x394))
    link.send(0x300 + DAC, b"\x80\x3f" * 4)
    link.sync()
    link.exchange(LATCH, UPLOAD_DEVICE_TYPE)
    assert (len(link.data(0x294)), len(link.data(0x394))) == counts
    link.nmt(PRE_OPERATIONAL, DAC)
    assert link.card(DAC).sdo[0x6411][1].raw == 0


@pytest.mark.parametrize("data", [b"", b"\x01", b"\x01\x00\x00", b"\x03\x00", b"\xff\x12"])
def test_what_is_no_nmt_command_changes_nothing(link, data: bytes) -> None:
    """7.2.8.3.1: two bytes, five command specifiers."""
    link.card(DAC).sdo[0x1017].raw = 10
    link.send(0x000, data)
    link.send(0x000, bytes((START, DAC)), extended=True)
    assert state_of(link, DAC) == 127


def test_reset_communication_leaves_the_application_and_reset_node_does_not(link) -> None:
    """7.3.2.2.1: reset application, reset communication."""
    dac = link.card(DAC)
    for command, heartbeat, error_value in ((RESET_COMMUNICATION, 0, 0x1000_0000), (RESET_NODE, 0, 0)):
        dac.sdo[0x1017].raw = 50
        dac.sdo[0x6444][1].raw = 0x1000_0000
        link.nmt(command, DAC)
        link.exchange(DAC, UPLOAD_DEVICE_TYPE)
        assert (dac.sdo[0x1017].raw, dac.sdo[0x6444][1].raw) == (heartbeat, error_value)
