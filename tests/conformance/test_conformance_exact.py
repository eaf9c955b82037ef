"""What needs exact virtual time: the link in this process alone. Each stamp follows from the objects that are set."""

import math

import pytest

START, STOP, PRE_OPERATIONAL = 0x01, 0x02, 0x80
DAC, LATCH, ADC = 0x12, 0x13, 0x14
TPDO2, TPDO3 = 0x280 + ADC, 0x380 + ADC
MS = 1_000_000
CYCLE_NS, CONVERSION_NS = 2_500_000, 100_000


def input_1(exact, **communication: int):
    """TPDO2 maps input 1 alone; `communication` as sub-indices s2, s3, s5, s6."""
    adc = exact.card(ADC)
    adc.sdo[0x1801][1].raw = 0x8000_0000 | TPDO2
    for name, value in communication.items():
        adc.sdo[0x1801][int(name[1:])].raw = value
    adc.sdo[0x1A01][0].raw = 0
    adc.sdo[0x1A01][1].raw = 0x64010110
    adc.sdo[0x1A01][0].raw = 1
    adc.sdo[0x1801][1].raw = TPDO2
    return adc


def run(exact, duration_ms: int) -> None:
    for _ in range(duration_ms):
        exact.let_pass(MS)


def wiggle(exact, volts) -> None:
    """The pin of input 1 follows `volts(time_ns)` instead of the arm."""
    device = exact.bench.rack.devices[ADC]
    device._sample = lambda channel: volts(exact.bench.time_ns) if channel == 0 else 0.0


def test_heartbeats_come_exactly_at_their_times(exact) -> None:
    """0x1017."""
    exact.card(DAC).sdo[0x1017].raw = 20
    run(exact, 100)
    assert exact.stamps(0x712) == [20 * MS * k for k in range(1, 6)]


def test_a_lost_heartbeat_is_noticed_exactly_at_its_time(exact) -> None:
    """0x1016."""
    exact.card(DAC).sdo[0x1016][1].raw = 1 << 16 | 100
    run(exact, 7)
    exact.send(0x701, b"\x05")
    run(exact, 200)
    assert exact.stamps(0x092) == [107 * MS]


def test_the_event_timer_runs_from_start_and_from_each_frame(exact) -> None:
    """0x1801:5."""
    input_1(exact, s2=254, s5=30)
    run(exact, 4)
    exact.nmt(START, ADC)
    run(exact, 100)
    assert exact.stamps(TPDO2) == [34 * MS, 64 * MS, 94 * MS]
    exact.nmt(PRE_OPERATIONAL, ADC)
    run(exact, 100)
    assert len(exact.stamps(TPDO2)) == 3


def test_inputs_are_scanned_for_events_every_scan_period(exact) -> None:
    """0x2010, 0x6423: each scan that finds another value is reported."""
    adc = input_1(exact, s2=255)
    wiggle(exact, lambda time_ns: 1.0 + time_ns // (25 * MS) * 0.1)
    adc.sdo[0x2010].raw = 10
    adc.sdo[0x6423].raw = True
    exact.nmt(START, ADC)
    run(exact, 99)
    assert exact.stamps(TPDO2) == [0, 30 * MS, 50 * MS, 80 * MS]
    assert [int.from_bytes(data, "little") >> 7 for data in exact.data(TPDO2)] == [51, 56, 61, 66]


def test_the_inhibit_time_keeps_frames_apart_and_the_last_value_is_sent_at_its_end(exact) -> None:
    """0x1801:3, in 100 µs."""
    adc = input_1(exact, s2=255, s3=355)
    wiggle(exact, lambda time_ns: time_ns // MS * 0.02)  # one code a millisecond
    adc.sdo[0x6423].raw = True
    exact.nmt(START, ADC)
    run(exact, 115)
    assert exact.stamps(TPDO2) == [0, 35_500_000, 71_000_000, 106_500_000]
    codes = [int.from_bytes(data, "little") >> 7 for data in exact.data(TPDO2)]
    assert codes == [round(time_ms * 0.02 * 51) for time_ms in (0, 30, 70, 100)]  # as of the last scan


@pytest.mark.parametrize(
    ("selected", "settings", "times_ms"),
    [
        (0x04, {0x6426: 5 << 23}, [0, 20, 40, 80]),  # differs by more than 5 codes from what was told
        (0x10, {0x6428: 10 << 23}, [0, 40]),  # increased by more than 10
        (0x18, {0x6427: 5 << 23, 0x6428: 10 << 23}, [0, 40, 80]),  # or reduced by more than 5
        (0x01, {0x6424: 13 << 23}, [40, 50, 60]),  # at or above 13, and changed
        (0x02, {0x6425: 7 << 23}, [0, 10, 20, 90]),  # below 7, and changed
        (0x05, {0x6424: 15 << 23, 0x6426: 10 << 23}, [50]),  # both conditions
    ],
)
def test_limits_and_deltas_say_what_is_an_event(exact, selected: int, settings: dict, times_ms: list[int]) -> None:
    """0x6421, 0x6424 to 0x6428; a triangle of 0 to 15.9 to 0 codes in 100 ms, scanned every 10 ms."""
    adc = input_1(exact, s2=255)
    wiggle(exact, lambda time_ns: (50 - abs(time_ns / MS - 50)) * 0.00625)
    adc.sdo[0x6421][1].raw = selected
    for index, value in settings.items():
        adc.sdo[index][1].raw = value
    adc.sdo[0x6423].raw = True
    exact.nmt(START, ADC)
    run(exact, 95)
    codes = [math.floor((50 - abs(t - 50)) * 0.00625 * 51 + 0.5) for t in range(0, 100, 10)]
    assert codes == [0, 3, 6, 10, 13, 16, 13, 10, 6, 3]
    assert exact.stamps(TPDO2) == [time_ms * MS for time_ms in times_ms]


def test_a_tpdo_leaves_when_its_conversions_are_done(exact) -> None:
    """Type 1: 100 µs for each wired channel that is mapped."""
    exact.nmt(START, ADC)
    for _ in range(3):
        exact.sync()
    assert exact.stamps(TPDO2) == exact.stamps(TPDO3) == [CYCLE_NS * k + 6 * CONVERSION_NS for k in (0, 1, 2)]


def test_a_type_252_tpdo_carries_what_the_last_sync_sampled_and_253_what_is_there_now(exact) -> None:
    """0x1801:2."""
    adc = input_1(exact, s2=252)
    exact.nmt(START, ADC)
    exact.sync()
    sampled = adc.sdo[0x6401][1].raw
    wiggle(exact, lambda time_ns: 5.0)
    device = exact.bench.rack.devices[ADC]
    device.scan(exact.bench.time_ns, ((0, 0, 0),), [2.0])
    exact.send(TPDO2, remote=True)
    exact.nmt(PRE_OPERATIONAL, ADC)
    adc.sdo[0x1801][2].raw = 253
    exact.nmt(START, ADC)
    exact.send(TPDO2, remote=True)
    assert [int.from_bytes(data, "little") for data in exact.data(TPDO2)] == [sampled, 0x7F80]


def test_rpdos_and_tpdos_outside_the_synchronous_window_do_not_count(exact) -> None:
    """0x1007: conversions take 600 µs, so a window of 500 µs is too short; RPDOs after it wait for no SYNC."""
    adc, dac = exact.card(ADC), exact.card(DAC)
    adc.sdo[0x1007].raw = dac.sdo[0x1007].raw = 500
    exact.nmt(START)
    exact.send(0x312, b"\x80\x00" * 4)  # before the first SYNC there is no window
    exact.sync()
    assert dac.sdo[0x6411][1].raw == 0x80
    exact.send(0x312, b"\x80\x01" * 4)  # 600 µs after SYNC
    exact.sync()
    assert dac.sdo[0x6411][1].raw == 0x80
    assert exact.data(TPDO2) == exact.data(TPDO3) == []
    adc.sdo[0x1007].raw = dac.sdo[0x1007].raw = 600
    exact.send(0x312, b"\x80\x01" * 4)
    exact.sync()
    assert dac.sdo[0x6411][1].raw == 0x180
    assert len(exact.data(TPDO2)) == 1


def test_the_inhibit_time_keeps_emcys_apart(exact) -> None:
    """0x1015, in 100 µs; a queue that overflows loses messages, not the register."""
    dac = exact.card(DAC)
    dac.sdo[0x1015].raw = 50
    exact.nmt(START, DAC)
    for _ in range(3):
        exact.send(0x312, b"")
        exact.send(0x312, bytes(8))
    run(exact, 40)
    assert exact.stamps(0x092) == [5 * MS * k for k in range(6)]
    assert [data[:2] for data in exact.data(0x092)] == [b"\x10\x82", b"\0\0"] * 3
    for _ in range(100):
        exact.send(0x312, b"")
        exact.send(0x312, bytes(8))
    exact.send(0x312, b"")
    assert dac.sdo[0x1001].raw == 0x11
    run(exact, 200)
    assert len(exact.data(0x092)) == 6 + 17


def test_an_rpdo_deadline_is_missed_exactly_at_its_time(exact) -> None:
    """0x1401:5; monitoring begins with the first frame and begins again with each."""
    exact.card(DAC).sdo[0x1401][5].raw = 30
    exact.nmt(START, DAC)
    run(exact, 100)
    exact.send(0x312, bytes(8))
    run(exact, 20)
    exact.send(0x312, bytes(8))
    run(exact, 100)
    assert exact.stamps(0x092) == [150 * MS]


def test_a_write_only_object_is_not_read() -> None:
    """Abort 0601 0001h: no card has such an object; the store keeps the rule."""
    from canopen import ObjectDictionary
    from canopen.objectdictionary import ODVariable, datatypes

    from canarm_emulator.node.store import ObjectStore, SdoRefused

    dictionary, variable = ObjectDictionary(), ODVariable("Command", 0x2000)
    variable.data_type, variable.access_type = datatypes.UNSIGNED8, "wo"
    dictionary.add_object(variable)
    store = ObjectStore(dictionary, lambda index, subindex: None, lambda index, subindex, data: False)
    store.write(0x2000, 0, b"\x01")
    with pytest.raises(SdoRefused, match=r"^0x06010001$"):
        store.read(0x2000, 0)
