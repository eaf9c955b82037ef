"""Every fault of signals, converters, wires and actuators at every tap of konkuk1, on a bench in lockstep.

Nothing controls here: both joints follow fixed outputs, so that two benches differ by the fault alone. Their supplies
are low enough for the motion to feel them.
"""

import functools
from typing import NamedTuple

import pytest

from canarm_emulator.faults.catalogue import Entry, catalogue_of
from canarm_emulator.faults.declaration import Family, TapKind
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import JointState
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Quantity
from canarm_protocol.cell.output_frames import OutputFrames
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.clock import Clock
from canarm_protocol.faults.script import parse_faults

CELL = load_cell("konkuk1")
OUTPUTS = OutputFrames(CELL, card_nodes(CELL))
DAC_COB_ID = 0x312  # its PDO maps four channels, of which two are wired
CLOCKWISE, COUNTER_CLOCKWISE = 0b01, 0b10
BEGIN, END, CYCLES = 30, 110, 130
TRUTH = Truth.from_settings(CELL, {"joint2.supply_v": "8", "joint3.supply_v": "8"})
FAMILIES = (Family.SIGNAL, Family.CONVERTER, Family.WIRING, Family.ACTUATOR)
MEASURING = (TapKind.SENSOR, TapKind.ADC_CODE)
ENTRIES = [entry for entry in catalogue_of(CELL) if entry.fault.family in FAMILIES]


class Cycle(NamedTuple):
    """What a cycle shows: the true joints at its SYNC, and the frames of the cards after it."""

    joints: tuple[JointState, ...]
    inputs: tuple[Frame, ...]


def outputs(cycle: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Codes that sweep their whole range, 75 ms against gravity and 25 ms the other way."""
    direction = CLOCKWISE if cycle % 40 >= 30 else COUNTER_CLOCKWISE
    return (cycle * 16 % 256, 255 - cycle * 16 % 256), (direction, direction)


def run(text: str = "") -> tuple[FaultBench, list[Cycle]]:
    bench = FaultBench(CELL, TRUTH, Clock.SYNC, 0)
    bench.start()
    bench.receive(nmt_frame(NmtCommand.START))
    if text:
        bench.inject(parse_faults(text))
    cycles = []
    for cycle in range(CYCLES):
        for cob_id, data, *_ in OUTPUTS.frames(*outputs(cycle)):
            bench.receive(Frame(cob_id, data.ljust(8, b"\0") if cob_id == DAC_COB_ID else data))
        bench.records.clear()
        bench.receive(sync_frame(None))
        cycles.append(Cycle(tuple(bench.world.state()), tuple(record.frame for record in bench.records[1:-1])))
    return bench, cycles


@functools.cache
def sound() -> list[Cycle]:
    return run()[1]


def text_of(entry: Entry, parameters: str = "") -> str:
    begin_s, duration_s = BEGIN * 0.0025, (END - BEGIN) * 0.0025
    return (
        f'[[set]]\nat = {begin_s}\nduration = {duration_s}\n[[set.fault]]\ntap = "{entry.tap.name}"\n'
        f'fault = "{entry.fault.name}"\n{parameters}'
    )


def met_by_the_motion(entry: Entry) -> str:
    """Parameters where with the defaults it takes luck for the signal to come by."""
    if entry.fault.name == "missing-code":
        return "code = 64\ncount = 128"
    if entry.fault.name == "saturated":
        return f"high = {entry.tap.low + 0.3 * (entry.tap.high - entry.tap.low)}"
    return ""


def entry_of(tap: str, fault: str) -> Entry:
    return next(entry for entry in ENTRIES if (entry.tap.name, entry.fault.name) == (tap, fault))


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: f"{entry.tap.name}-{entry.fault.name}")
def test_a_fault_changes_something_while_it_lasts_and_nothing_before_or_after(entry: Entry) -> None:
    reference = sound()
    bench, cycles = run(text_of(entry, met_by_the_motion(entry)))
    assert cycles[:BEGIN] == reference[:BEGIN]
    assert cycles[BEGIN:END] != reference[BEGIN:END]
    assert bench.faults.active == 0
    if entry.tap.kind in MEASURING:
        assert [each.joints for each in cycles] == [each.joints for each in reference]
        assert cycles[END:] == reference[END:]
    else:
        commands = [[joint.command_a for joint in each.joints] for each in cycles[END:]]
        assert commands == [[joint.command_a for joint in each.joints] for each in reference[END:]]
        assert bench.world.truth == TRUTH


def test_the_names_are_those_of_the_vocabulary() -> None:
    assert {entry.fault.name for entry in ENTRIES} == {
        *("stuck", "offset", "gain", "drift", "noise", "spike", "saturated", "dropout", "delayed", "intermittent"),
        *("stuck-bit", "missing-code"),
        *("open-load", "short-to-ground", "short-to-supply", "in-line-resistance", "leakage", "loose-contact"),
        *("ground-shift", "supply-undervoltage", "supply-overvoltage"),
        *("current-limit", "thermal-trip", "reversed-direction", "latch-bit-stuck"),
        *("winding-open", "winding-short", "loss-of-torque-constant"),
    }


def test_what_a_fault_does_is_said_in_one_sentence() -> None:
    for entry in ENTRIES:
        line = (entry.fault.__doc__ or "").splitlines()[0]
        assert line.endswith("."), entry.fault
        assert not line.startswith(entry.fault.__name__ + "("), entry.fault  # what a dataclass says by itself


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: f"{entry.tap.name}-{entry.fault.name}")
def test_defaults_lie_within_their_bounds(entry: Entry) -> None:
    for parameter in entry.parameters:
        if isinstance(parameter.default, int | float):
            assert parameter.minimum <= parameter.default <= parameter.maximum


def test_nothing_is_left_on_the_way_of_a_sensor_when_its_fault_is_over() -> None:
    bench, _ = run()
    seen: list[float] = []

    def look(volts: float) -> float:
        seen.append(volts)
        return volts

    bench.rack.distort_input(0, Quantity.VELOCITY, look)
    bench.receive(sync_frame(None))
    bench.rack.distort_input(0, Quantity.VELOCITY, None)
    bench.receive(sync_frame(None))
    assert len(seen) == 1


# A few, to the number that a controller sees


def codes(cycles: list[Cycle], channel: int) -> list[int]:
    """What the ADC's TPDOs say of a channel (from 1): 16-bit, left-adjusted values of 8 bits, four to a frame."""
    found = []
    for cycle in cycles[BEGIN:END]:
        frame = [each for each in cycle.inputs if each.can_id & 0x7F == 0x14][(channel - 1) // 4]
        place = 2 * ((channel - 1) % 4)
        found.append(int.from_bytes(frame.data[place : place + 2], "little") >> 7)
    return found


def test_an_adc_channel_with_a_stuck_bit_is_read_over_the_bus_with_that_bit() -> None:
    _, cycles = run(text_of(entry_of("adc.channel1", "stuck-bit"), "bit = 7\nvalue = 0"))
    assert codes(cycles, 1) == [code & 0x7F for code in codes(sound(), 1)]


def test_a_short_to_supply_reads_full_scale_at_its_channel_alone() -> None:
    _, cycles = run(text_of(entry_of("joint3.tachometer", "short-to-supply")))
    assert set(codes(cycles, 4)) == {255}
    assert codes(cycles, 3) == codes(sound(), 3)


def test_a_ground_shift_of_a_quarter_volt_is_13_codes() -> None:
    _, cycles = run(text_of(entry_of("joint2.potentiometer", "ground-shift"), "shift = 0.25"))
    shifts = {code - sane for code, sane in zip(codes(cycles, 1), codes(sound(), 1), strict=True)}
    assert shifts <= {12, 13}  # 0.25 V / (5 V / 255) = 12.75


def test_a_dac_code_that_is_stuck_holds_the_current_between_messages() -> None:
    _, cycles = run(text_of(entry_of("joint2.dac.code", "stuck"), "value = 51"))
    magnitudes = {round(abs(cycle.joints[0].command_a), 9) for cycle in cycles[BEGIN:END]}
    assert magnitudes == {0.3}  # 51 · 1.5 A / 255


def test_an_opamp_that_is_stuck_at_3_volts_asks_for_0_3_amperes() -> None:
    _, cycles = run(text_of(entry_of("joint3.opamp", "stuck"), "value = 3"))
    assert {round(abs(cycle.joints[1].command_a), 9) for cycle in cycles[BEGIN:END]} == {0.3}


def test_a_drift_goes_on_while_no_message_changes_the_output() -> None:
    _, cycles = run(text_of(entry_of("joint3.amplifier.current", "drift"), "rate = 1.0"))
    for age, (cycle, sane) in enumerate(zip(cycles[BEGIN:END], sound()[BEGIN:END], strict=True)):
        expected = min(abs(sane.joints[1].command_a) + age * 0.0025, 1.5)
        assert abs(cycle.joints[1].command_a) == pytest.approx(expected)


def test_reversed_direction_turns_the_current_round() -> None:
    _, cycles = run(text_of(entry_of("joint2.latch", "reversed-direction")))
    for cycle, sane in zip(cycles[BEGIN:END], sound()[BEGIN:END], strict=True):
        assert cycle.joints[0].command_a == -sane.joints[0].command_a


def test_both_bits_of_a_latch_at_once_count_as_illegal_once_a_change() -> None:
    bench, cycles = run(text_of(entry_of("joint2.latch", "stuck"), "value = 3"))
    assert {cycle.joints[0].command_a for cycle in cycles[BEGIN:END]} == {0.0}
    assert bench.world.illegal_directions == [1, 0]


def test_a_broken_motor_lead_shows_in_the_current_sense_and_the_command_stays() -> None:
    _, cycles = run(text_of(entry_of("joint2.motor", "open-load")))
    assert [cycle.joints[0].command_a for cycle in cycles] == [cycle.joints[0].command_a for cycle in sound()]
    assert max(abs(cycle.joints[0].current_a) for cycle in cycles[BEGIN + 1 : END]) < 50e-9
    assert set(codes(cycles, 5)) <= {0, 1}  # 0.3 LSB of noise
