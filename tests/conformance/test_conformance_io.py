"""I/O modules (CiA 401): digital outputs with their filter, analogue outputs and inputs, events of inputs."""

import struct

START, STOP = 0x01, 0x02
DAC, LATCH, ADC = 0x12, 0x13, 0x14
TPDO2, TPDO3 = 0x280 + ADC, 0x380 + ADC


def test_the_filter_mask_says_which_outputs_change(link) -> None:
    """0x6200, 0x6208."""
    latch = link.card(LATCH)
    latch.sdo[0x6200][1].raw = 0xF0
    latch.sdo[0x6208][1].raw = 0x3C
    latch.sdo[0x6200][1].raw = 0x0A
    assert latch.sdo[0x6200][1].raw == 0xC8
    link.reset()
    latch = link.card(LATCH)
    latch.sdo[0x6200][1].raw = 0x0A
    assert latch.sdo[0x6200][1].raw == 0x0A


def test_the_filter_mask_holds_for_rpdos(link) -> None:
    """0x6208 with 0x1600."""
    latch = link.card(LATCH)
    latch.sdo[0x6208][1].raw = 0x0F
    link.nmt(START, LATCH)
    link.send(0x213, b"\xff")
    link.sync()
    assert latch.sdo[0x6200][1].raw == 0x0F


def test_analogue_outputs_are_left_adjusted_in_8_and_16_bits(link) -> None:
    """0x6410 and 0x6411: an 8-bit code below the sign bit; 0x6410 has room for its upper seven bits."""
    dac = link.card(DAC)
    dac.sdo[0x6411][1].raw = 0x7FFF
    assert (dac.sdo[0x6411][1].raw, dac.sdo[0x6410][1].raw) == (255 << 7, 127)
    dac.sdo[0x6410][2].raw = 0x41
    assert (dac.sdo[0x6411][2].raw, dac.sdo[0x6410][2].raw) == (0x4100, 0x41)


def test_an_8_bit_output_can_be_mapped(link) -> None:
    """0x6410 in 0x1601."""
    dac = link.card(DAC)
    dac.sdo[0x1401][1].raw = 0x8000_0312
    dac.sdo[0x1601][0].raw = 0
    for number in (1, 2, 3, 4):
        dac.sdo[0x1601][number].raw = 0x64100008 | number << 8
    dac.sdo[0x1601][0].raw = 4
    dac.sdo[0x1401][1].raw = 0x312
    link.nmt(START, DAC)
    link.send(0x312, bytes((1, 2, 3, 127)))
    link.sync()
    assert [dac.sdo[0x6411][channel].raw for channel in range(1, 5)] == [0x100, 0x200, 0x300, 0x7F00]


def map_tpdo2(adc, entries: list[int], kind: int = 1) -> None:
    """TPDO2 with another mapping and transmission type."""
    adc.sdo[0x1801][1].raw = 0x8000_0000 | TPDO2
    adc.sdo[0x1801][2].raw = kind
    adc.sdo[0x1A01][0].raw = 0
    for number, entry in enumerate(entries, 1):
        adc.sdo[0x1A01][number].raw = entry
    adc.sdo[0x1A01][0].raw = len(entries)
    adc.sdo[0x1801][1].raw = TPDO2


def test_analogue_inputs_are_left_adjusted_in_8_and_16_bits(link) -> None:
    """0x6400 and 0x6401: the two tell the same conversion; channels that are not wired read 0."""
    adc = link.card(ADC)
    # In one frame: the arm may be moving, and on a busy machine time passes between two reads by SDO.
    map_tpdo2(adc, [0x64010110, 0x64000108])
    link.nmt(START, ADC)
    wide, narrow = struct.unpack("<hb", link.cycle(TPDO2))
    assert wide & 0x7F == 0
    assert 0 < wide <= 255 << 7
    assert narrow == wide >> 8
    assert adc.sdo[0x6401][8].raw == adc.sdo[0x6400][8].raw == 0


def test_a_tpdo_carries_what_sdo_shows(link) -> None:
    """0x6401 in 0x1A01: between two SYNCs SDO shows the last scan."""
    adc = link.card(ADC)
    link.nmt(START, ADC)
    link.cycle(TPDO3)
    data = link.data(TPDO2)[-1]
    assert list(struct.unpack("<4h", data)) == [adc.sdo[0x6401][channel].raw for channel in range(1, 5)]


def event_driven(adc) -> None:
    """TPDO2 maps input 1 alone and is event-driven."""
    map_tpdo2(adc, [0x64010110], kind=255)


def test_the_interrupt_enable_lets_inputs_send_by_themselves(link) -> None:
    """0x6423 with type 255: the first scan is reported, in OPERATIONAL too; 0x6422 names the channel and clears."""
    adc = link.card(ADC)
    event_driven(adc)
    link.nmt(START, ADC)
    link.cycle(TPDO3)
    assert link.data(TPDO2) == []
    adc.sdo[0x6423].raw = True
    link.await_frames(TPDO2)
    adc.sdo[0x6423].raw = False
    assert adc.sdo[0x6422][1].raw == 1
    assert adc.sdo[0x6422][1].raw == 0


def test_an_input_without_a_trigger_causes_no_event(link) -> None:
    """0x6421 = 0."""
    adc = link.card(ADC)
    event_driven(adc)
    adc.sdo[0x6421][1].raw = 0
    adc.sdo[0x6423].raw = True
    link.nmt(START, ADC)
    for _ in range(20):
        link.cycle(TPDO3)
    assert link.data(TPDO2) == []
