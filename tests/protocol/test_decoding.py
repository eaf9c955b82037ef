"""Frames in words. Frames and their meaning come from CiA 301's tables, from examples/by_hand.md as candump showed
them, and from python-can's and cantools' own decoders.
"""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from canarm_protocol.canopen.frames import ERROR_FLAG, Frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.dbc_file import Signal
from canarm_protocol.decoding import Book, Decoder, Field, Sort, bench_book, raw_text, robot_book
from canarm_protocol.decoding.signals import SignalMessage, signal_text


def frame(text: str) -> Frame:
    """A frame as cansend takes it."""
    can_id, _, data = text.partition("#")
    return Frame(int(can_id, 16), bytes.fromhex(data), len(can_id) == 8)


@pytest.fixture(scope="module")
def cell():
    return load_cell("konkuk1")


@pytest.fixture
def decoder(cell):
    return Decoder(robot_book(cell))


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        ("000#8112", "NMT: reset-node to dac"),
        ("000#0100", "NMT: start to all nodes"),
        ("000#017F", "NMT: start to node 0x7F"),
        ("712#00", "heartbeat of dac: boot-up"),
        ("701#05", "heartbeat of controller: operational"),
        ("77F#7F", "heartbeat of node 0x7F: pre-operational"),
        ("080#", "SYNC"),
        ("080#1F", "SYNC: counter 31"),
        # 3 ms after midnight of 1984-01-01.
        ("100#030000000000", "TIME: since midnight 0.003 s, day 0"),
        # 0x4900 >> 7 is code 146, and (146 - 127.5) * 270/255 are 19.588 degrees; 0x3F80 >> 7 is code 127 of 255.
        ("294#00490040803F803F", (19.588, 0.529, -0.0098, -0.0098)),
        # 0.4 A are code 68 = 0x44, on the wire 0x44 << 7.
        ("312#00220000", "RPDO2 of dac: joint2.current_command 0.4000 A, joint3.current_command 0.0000 A"),
        ("213#02", "RPDO1 of latch: joint2.direction counter-clockwise, joint3.direction off"),
        ("614#4000200000000000", "SDO to adc: read 0x2000:00 Clock of the emulated world (0 wall, 1 lockstep)"),
        ("594#4B01640100490000", "SDO of adc: 0x6401:01 Analogue input 1 = 18688 (0x4900)"),
        ("592#8011640110000706", "SDO of dac: abort 0x6411:01 Analogue output 1: data type does not match, length of "
         "service parameter does not match (0x06070010)"),
        ("592#6011640100000000", "SDO of dac: 0x6411:01 Analogue output 1 written"),
        ("612#2B11640100220000", "SDO to dac: write 0x6411:01 Analogue output 1 = 8704 (0x2200)"),
        ("094#4102110000000000", "EMCY of adc: 0x0241 reserved code, error register 0x11 (generic, communication)"),
        ("094#3081110000000000", "EMCY of adc: 0x8130 life guard or heartbeat error, error register 0x11 (generic, "
         "communication)"),
        ("094#0000000000000000", "EMCY of adc: 0x0000 no error, or error reset"),
        # Codes without a text of their own have that of their class (CiA 301, table 26).
        ("0FF#42230100000000AA", "EMCY of node 0x7F: 0x2342 current, device output side, error register 0x01 "
         "(generic), 00 00 00 00 aa"),
        ("1FF#00", "TPDO1 of node 0x7F, by its COB-ID"),
        ("7E5#00", "unknown"),
        ("00000080#00", "29-bit identifier, not CANopen's"),
    ],
)  # fmt: skip
def test_a_frame_is_said_in_words(decoder, text, meaning):
    found = decoder.meaning(frame(text))
    if isinstance(meaning, str):
        assert str(found).strip() == meaning
        assert found.is_wrong == any(word in text for word in ("592#80", "094#3081", "094#4102", "0FF#"))
    else:
        assert [float(field.text.split()[0]) for field in found.fields] == pytest.approx(meaning, abs=1e-3)
        assert [field.text.split()[1] for field in found.fields] == ["deg", "deg", "rad/s", "rad/s"]
        assert [field.start_bit for field in found.fields] == [0, 16, 32, 48]


@pytest.mark.parametrize(
    "text", ["000#01", "000#0399", "080#0102", "100#00", "701#", "701#0505", "094#00", "294#0049", "614#40", "701#06",
             "594#E000000000000000"]
)  # fmt: skip
def test_what_breaks_the_protocol_is_marked_and_named(decoder, text):
    found = decoder.meaning(frame(text))
    assert found.is_wrong
    assert any(word in str(found) for word in ("malformed", "unknown")), found


def test_error_frames_and_remote_frames_are_no_messages(decoder):
    # CAN_ERR_BUSOFF is 0x40, CAN_ERR_ACK 0x20 (linux/can/error.h).
    error = Frame(ERROR_FLAG | 0x60, bytes(8), True)
    assert str(decoder.meaning(error)) == "error frame: no acknowledge, bus-off"
    assert decoder.meaning(error).sort is Sort.ERROR
    assert str(decoder.meaning(Frame(0x294, bytes(8), False, True))) == "remote frame"
    assert raw_text(Frame(0x294, bytes(8), False, True)) == "294#R"
    assert raw_text(frame("1FFFFFFF#0102")) == "1FFFFFFF#0102"


def test_segments_are_told_by_the_object_of_their_transfer(decoder):
    """The upload of a device name in CiA 301, 7.2.4.3.6: initiated with its size, then segments of seven bytes."""
    said = []
    for text in ("614#4008100000000000", "594#4108100009000000", "614#6000000000000000", "594#0041444330383039",
                 "614#7000000000000000", "594#1B58590000000000"):  # fmt: skip
        about = decoder.follow(frame(text))
        said.append(decoder.meaning(frame(text), about).text)
    where = "0x1008:00 Manufacturer device name"
    assert said == [
        f"read {where}",
        f"{where} of 9 bytes in segments",
        f"next segment of {where}",
        f"segment of {where}: 41 44 43 30 38 30 39",
        f"next segment of {where}",
        f"segment of {where}: 58 59, the last",
    ]


def test_block_segments_are_not_taken_for_commands(decoder):
    """Numbered segments have any first byte: 0x81 is the last one, number 1, and no abort (CiA 301, 7.2.4.3.13)."""
    said = []
    for text in ("614#A00810007F000000", "594#C208100004000000", "614#A300000000000000", "594#8141424344000000",
                 "614#A2017F0000000000", "594#CD00000000000000"):  # fmt: skip
        about = decoder.follow(frame(text))
        said.append(decoder.meaning(frame(text), about))
    assert "block segment 1 of 0x1008:00" in said[3].text
    assert not any(each.is_wrong for each in said)


def test_without_a_cell_nodes_go_by_their_numbers():
    decoder = Decoder(Book())
    assert str(decoder.meaning(frame("705#05"))) == "heartbeat of node 0x05: operational"
    assert str(decoder.meaning(frame("605#4018100100000000"))) == "SDO to node 0x05: read 0x1018:01"
    assert str(decoder.meaning(frame("585#43181001AA010000"))) == "SDO of node 0x05: 0x1018:01 = aa 01 00 00"


def test_the_bench_bus_has_its_own_channels_and_telemetry(cell):
    decoder, node_id = Decoder(bench_book(cell)), cell.bus.bench_node_id
    request = Frame(0x630 + 2, bytes.fromhex("4000240000000000"))
    assert str(decoder.meaning(request)).startswith("SDO to bench, channel 2: read 0x2400:00 Fault set to be done")
    status = Frame(0x180 + node_id, (1234).to_bytes(4, "little"))
    assert str(decoder.meaning(status)) == "TPDO1 of bench: cycle 1234"


def test_longer_process_data_are_read_as_far_as_they_are_mapped(decoder):
    assert "joint2.current_command 0.4000 A" in str(decoder.meaning(frame("312#0022000000000000")))


@pytest.mark.parametrize(
    ("signal", "raw", "text"),
    [
        (Signal("a", 0, 8), 200, "200"),
        (Signal("a", 0, 8, is_signed=True), 200, "-56"),
        (Signal("a", 0, 16, factor=0.1, offset=-40.0, unit="°C"), 655, "25.5 °C"),
        (Signal("a", 0, 32, is_float=True, unit="rad"), 0x40490FDB, f"{math.pi:.6f} rad"),
        (Signal("a", 0, 2, choices={2: "open"}), 0b110, "open"),
        (Signal("a", 0, 32, is_float=True), 0x7FC00000, "nan"),
    ],
)
def test_a_signal_has_its_sign_scale_unit_and_words(signal, raw, text):
    assert signal_text(signal, raw) == text


def test_the_bits_of_a_big_endian_field_run_as_in_a_dbc_file():
    """DBC's own numbering, as cantools draws it: start bit 3 with 10 bits fills byte 0 down, then byte 1 from bit 7."""
    assert Field("a", "", 3, 10, is_big_endian=True).bits == (3, 2, 1, 0, 15, 14, 13, 12, 11, 10)
    assert Field("a", "", 3, 4).bits == (3, 4, 5, 6)


def books():
    """What can be known of a bus: nothing, a cell, a file with scales that no number bears."""
    cell = load_cell("konkuk1")
    strange = Book()
    signals = [Signal("a", 0, 16, factor=factor, unit="x") for factor in (0.0, 1e308, 1e-320, math.inf, math.nan)]
    strange.messages[0x123, False] = SignalMessage("strange", 2, [*signals, Signal("b", 0, 64, is_float=True)])
    return [Book(), robot_book(cell), bench_book(cell), strange]


@given(
    st.lists(
        st.builds(
            Frame,
            st.one_of(st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF), st.sampled_from([0x123, ERROR_FLAG | 0x1FF])),
            st.binary(max_size=64),
            st.booleans(),
            st.booleans(),
        ),
        max_size=20,
    )
)
@settings(max_examples=200, deadline=None)
def test_no_frame_whatever_makes_a_decoder_fail(frames):
    for book in BOOKS:
        decoder = Decoder(book)
        for each in frames:
            meaning = decoder.meaning(each, decoder.follow(each))
            assert str(meaning)
            assert raw_text(each)
            assert all(field.bits is not None for field in meaning.fields)


BOOKS = books()
