"""A run from bring-up to its end, and every way out of it: frames between controller and bench are bent by hand."""

import struct
from collections.abc import Callable, Iterable

import pytest

from canarm_controller.errors import BringUpError, ClockMismatchError, ControllerError
from canarm_controller.run.state import State
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import Emergency, Frame, NmtState, time_frame
from canarm_protocol.clock import Clock

# COB-IDs of CiA 301's predefined connection set, and konkuk1's nodes: DAC 0x12, latch 0x13, ADC 0x14.
SYNC, TIME, EMERGENCY, HEARTBEAT, SDO_ANSWER = 0x080, 0x100, 0x080, 0x700, 0x580
DAC, LATCH, ADC = 0x12, 0x13, 0x14
NODES = {DAC: "dac", LATCH: "latch", ADC: "adc"}
POSITIONS_AND_SPEEDS, CURRENTS = 0x294, 0x394
DAC_OUTPUTS, LATCH_OUTPUTS = 0x312, 0x213
CYCLES_A_SECOND = 400
CYCLE_NS = 2_500_000


def from_node(frame: Frame, node_id: int) -> bool:
    return frame.can_id & 0x7F == node_id and frame.can_id not in (0, TIME)


def sdo_upload_answer(node_id: int, index: int, subindex: int, value: int) -> Callable[[Frame], Iterable[Frame]]:
    """A wire on which one object of one node reads as `value`."""

    def wire(frame: Frame) -> Iterable[Frame]:
        is_upload = frame.can_id == SDO_ANSWER + node_id and frame.data[0] & 0xE0 == 0x40
        if is_upload and struct.unpack_from("<HB", frame.data, 1) == (index, subindex):
            return (Frame(frame.can_id, frame.data[:4] + value.to_bytes(4, "little")),)
        return (frame,)

    return wire


def dropping(is_lost: Callable[[Frame], bool]) -> Callable[[Frame], Iterable[Frame]]:
    return lambda frame: () if is_lost(frame) else (frame,)


def outputs(frames: Iterable[Frame]) -> dict[int, bytes]:
    """The last process data sent to each card."""
    return {frame.can_id: frame.data for frame in frames if frame.can_id in (DAC_OUTPUTS, LATCH_OUTPUTS)}


# Bring-up and the planned end


def test_a_run_of_so_many_ticks_ends_done_with_torque_off_and_cards_stopped(make_pair) -> None:
    pair = make_pair(ticks=200)
    pair.run_to_end()
    controller = pair.controller
    assert (controller.state, controller.controlled_ticks, controller.missed) == (State.DONE, 200, 0)
    assert controller.reason is None
    assert {slave.state for slave in pair.bench.slaves} == {NmtState.PRE_OPERATIONAL}
    assert all(not any(data) for data in outputs(pair.sent).values())
    assert all(joint.command_a == 0.0 for joint in pair.bench.world.state())


def test_zero_outputs_act_before_the_cards_are_stopped(make_pair) -> None:
    pair = make_pair(ticks=200)
    commands = []
    pair.to_bench = lambda frame: (
        commands.append([joint.command_a for joint in pair.bench.world.state()]) if frame.can_id == 0 else None,
        (frame,),
    )[1]
    pair.run_to_end()
    first_stop = commands[-2 * len(NODES)]
    assert first_stop == [0.0, 0.0]


@pytest.mark.parametrize("node_id", NODES)
def test_a_card_that_is_missing_ends_the_bring_up_and_is_named(pair, node_id: int) -> None:
    pair.to_controller = dropping(lambda frame: from_node(frame, node_id))
    pair.run_to_end()
    assert pair.controller.state is State.FAILED
    assert isinstance(pair.controller.error, BringUpError)
    assert f"card '{NODES[node_id]}' (node 0x{node_id:02X}) does not answer" in pair.controller.reason


def test_a_card_that_falls_silent_while_it_is_configured_is_named(pair) -> None:
    pair.to_controller = dropping(lambda frame: frame.can_id == SDO_ANSWER + LATCH)
    pair.run_to_end()
    assert "card 'latch' (node 0x13) stopped answering" in pair.controller.reason


@pytest.mark.parametrize("node_id", NODES)
@pytest.mark.parametrize(
    ("index", "subindex", "what"),
    [(0x1000, 0, "device type"), (0x1018, 1, "vendor-ID"), (0x1018, 2, "product code"), (0x1018, 3, "revision")],
)
def test_a_card_of_another_identity_is_refused(pair, node_id: int, index: int, subindex: int, what: str) -> None:
    pair.to_controller = sdo_upload_answer(node_id, index, subindex, 0xDEAD)
    pair.run_to_end()
    assert pair.controller.state is State.FAILED
    assert f"card '{NODES[node_id]}'" in pair.controller.reason
    assert f"{what} (0x{index:04X}:{subindex:02X}) is 0x0000DEAD" in pair.controller.reason


@pytest.mark.parametrize(("node_id", "index"), [(DAC, 0x1016), (LATCH, 0x6207), (ADC, 0x1A01), (ADC, 0x1801)])
def test_a_card_that_refuses_its_configuration_ends_the_bring_up(pair, node_id: int, index: int) -> None:
    refused = 0x0609_0030  # CiA 301, table 22: invalid value for parameter

    def wire(frame: Frame) -> Iterable[Frame]:
        is_written = frame.can_id == SDO_ANSWER + node_id and frame.data[0] == 0x60
        if is_written and struct.unpack_from("<H", frame.data, 1)[0] == index:
            return (Frame(frame.can_id, b"\x80" + frame.data[1:4] + struct.pack("<I", refused)),)
        return (frame,)

    pair.to_controller = wire
    pair.run_to_end()
    assert pair.controller.state is State.FAILED
    assert f"card '{NODES[node_id]}'" in pair.controller.reason
    assert f"0x{index:04X}" in pair.controller.reason
    assert "0x06090030" in pair.controller.reason


def test_an_answer_of_the_wrong_length_ends_the_bring_up(pair) -> None:
    def wire(frame: Frame) -> Iterable[Frame]:
        if frame.can_id == SDO_ANSWER + ADC and frame.data[:3] == b"\x4b\x01\x64":  # upload of 0x6401, two bytes
            return (Frame(frame.can_id, b"\x4f" + frame.data[1:]),)  # one byte
        return (frame,)

    pair.to_controller = wire
    pair.run_to_end()
    assert "card 'adc' (node 0x14): SDO 0x6401:01 has 1 bytes; must be 2" in pair.controller.reason


@pytest.mark.parametrize(("ours", "theirs"), [(Clock.WALL, Clock.SYNC), (Clock.SYNC, Clock.WALL)])
def test_another_clock_on_the_cards_is_a_clock_mismatch(make_pair, ours: Clock, theirs: Clock) -> None:
    pair = make_pair(clock=ours, bench_clock=theirs)
    pair.run_to_end()
    assert isinstance(pair.controller.error, ClockMismatchError)
    assert f"--clock {theirs.name.lower()}, its master on --clock {ours.name.lower()}" in pair.controller.reason


@pytest.mark.parametrize(
    ("frame", "what"), [(Frame(SYNC), "SYNC"), (Frame(HEARTBEAT + 1, b"\x05"), "heartbeats of node 1")]
)
def test_another_master_heard_while_listening_keeps_the_controller_off_the_bus(
    make_pair, frame: Frame, what: str
) -> None:
    pair = make_pair(listen_ns=250_000_000)
    pair.begin()
    pair.controller.receive(frame, 0)
    assert pair.controller.state is State.FAILED
    assert f"another controller is on the bus ({what} seen)" in pair.controller.reason
    assert pair.controller.outbox == []


@pytest.mark.parametrize(
    "frame",
    [
        Frame(SYNC, is_extended=True),
        Frame(SYNC, is_remote=True),
        Frame(HEARTBEAT + ADC, b"\x7f"),
        Frame(0x123, b"\x01"),
    ],
    ids=["29 bits", "remote", "a card's heartbeat", "unknown"],
)
def test_other_traffic_while_listening_is_no_master(make_pair, frame: Frame) -> None:
    pair = make_pair(listen_ns=250_000_000)
    pair.begin()
    pair.controller.receive(frame, 0)
    pair.run_to(State.RUNNING)


def test_nothing_is_sent_while_listening(make_pair) -> None:
    pair = make_pair(listen_ns=250_000_000)
    pair.begin()
    assert (pair.controller.outbox, pair.controller.deadline_ns) == ([], 250_000_000)


def test_a_pose_out_of_reach_of_every_blend_ends_the_bring_up_with_the_cards_stopped(make_pair) -> None:
    pair = make_pair(truth={"joint2.initial_deg": "129", "joint2.potentiometer_offset_deg": "5"})
    pair.run_to_end()
    assert pair.controller.state is State.FAILED
    assert "outside limits_deg" in pair.controller.reason
    assert pair.sent[-6:] == [Frame(0, bytes((command, node_id))) for command in (0x02, 0x80) for node_id in NODES]


# Supervision of a run


def assert_stopped(pair, detector: str, *words: str) -> None:
    """The run fails for that reason, and the robot is left without torque."""
    pair.run_to_end()
    controller = pair.controller
    assert controller.state is State.FAILED
    assert controller.verdict is not None, controller.reason
    assert controller.verdict.detector == detector
    for word in words:
        assert word in controller.verdict.detail
    assert all(not any(data) for data in outputs(pair.sent).values())


@pytest.mark.parametrize(
    ("frame", "word"), [(Frame(SYNC, b"\x07"), "SYNC"), (Frame(HEARTBEAT + 1, b"\x05"), "node-ID")]
)
def test_a_foreign_master_in_a_run_stops_the_robot(pair, frame: Frame, word: str) -> None:
    pair.run_to_tick(100)
    pair.controller.receive(frame, pair.bench.time_ns)
    assert_stopped(pair, "foreign-master", word, "another controller")


@pytest.mark.parametrize("cob_id", [POSITIONS_AND_SPEEDS, CURRENTS])
def test_lost_inputs_stop_the_robot_after_so_many_cycles_and_are_named(pair, cob_id: int) -> None:
    pair.run_to_tick(100)
    pair.to_controller = dropping(lambda frame: frame.can_id == cob_id)
    before = pair.controller.controlled_ticks
    pair.run_to(State.STOPPING)
    assert pair.controller.missed == pair.cell.supervision.missing_cycles == 16
    assert pair.controller.controlled_ticks - before == 15
    assert_stopped(pair, "inputs-missing", f"TPDO 0x{cob_id:03X} of node 0x14", "16 cycles")


def test_a_few_lost_inputs_are_counted_and_do_not_stop_the_robot(pair) -> None:
    pair.run_to_tick(100)
    pair.to_controller = dropping(lambda frame: frame.can_id == CURRENTS and pair.controller.tick < 107)
    pair.run_to_tick(200)
    assert (pair.controller.state, pair.controller.missed) == (State.RUNNING, 7)


def test_both_lost_inputs_are_named(pair) -> None:
    pair.run_to_tick(100)
    pair.to_controller = dropping(lambda frame: frame.can_id in (POSITIONS_AND_SPEEDS, CURRENTS))
    assert_stopped(pair, "inputs-missing", "TPDO 0x294 of node 0x14 and TPDO 0x394 of node 0x14")


@pytest.mark.parametrize("node_id", NODES)
def test_a_lost_heartbeat_stops_the_robot_after_its_timeout(pair, node_id: int) -> None:
    pair.run_to_tick(100)
    pair.to_controller = dropping(lambda frame: frame.can_id == HEARTBEAT + node_id)
    pair.run_to(State.STOPPING)
    # 100 ms are 40 cycles, counted from the last heartbeat, at most 20 ms = 8 cycles before tick 100.
    assert 100 + 40 - 8 <= pair.controller.tick <= 100 + 41
    assert_stopped(pair, "heartbeat-lost", f"card '{NODES[node_id]}' (node 0x{node_id:02X}) silent for 100 ms")


def test_an_emergency_of_a_card_stops_the_robot(pair) -> None:
    pair.run_to_tick(100)
    pair.controller.receive(Emergency(0x8130, 0x11).frame(DAC), pair.bench.time_ns)
    assert_stopped(pair, "card-emergency", "card 'dac' (node 0x12)", "0x8130")


@pytest.mark.parametrize(
    "frame",
    [
        Emergency(0x0000, 0).frame(DAC),
        Frame(EMERGENCY + DAC, b"\x30\x81"),
        Frame(HEARTBEAT + DAC, b""),
        Frame(HEARTBEAT + DAC, b"\x04\x04"),
        Frame(HEARTBEAT + 0x55, b"\x00"),
        Frame(EMERGENCY + 0x55, bytes(8)),
        Frame(POSITIONS_AND_SPEEDS, b"\x00\x40"),
        Frame(POSITIONS_AND_SPEEDS, b"\xff\xff" * 4),
        Frame(POSITIONS_AND_SPEEDS, bytes(8), is_extended=True),
        Frame(POSITIONS_AND_SPEEDS, is_remote=True),
        Frame(SYNC, is_extended=True),
        Frame(0x7FF, bytes(8)),
    ],
    ids=lambda frame: f"{frame.can_id:03X}-{frame.data.hex()}{'x' * frame.is_extended}{'r' * frame.is_remote}",
)
def test_a_malformed_or_harmless_frame_stops_nothing(make_pair, frame: Frame) -> None:
    runs = [make_pair(), make_pair()]
    for pair in runs:
        pair.run_to_tick(100)
    runs[0].controller.receive(frame, runs[0].bench.time_ns)
    for pair in runs:
        pair.run_to_tick(200)
        assert (pair.controller.state, pair.controller.missed) == (State.RUNNING, 0)
    assert runs[0].sent == runs[1].sent


@pytest.mark.parametrize("data", [b"\x00\x40", b"\xff\xff" * 4], ids=["too short", "negative"])
def test_malformed_inputs_are_missing_inputs(pair, data: bytes) -> None:
    pair.run_to_tick(100)
    pair.to_controller = lambda frame: (frame._replace(data=data) if frame.can_id == POSITIONS_AND_SPEEDS else frame,)
    assert_stopped(pair, "inputs-missing", "TPDO 0x294 of node 0x14")
    assert pair.controller.ignored_frames >= 8


def test_a_card_that_resets_itself_stops_the_robot(pair) -> None:
    pair.run_to_tick(100)
    pair.bench.receive(Frame(0, bytes((0x81, LATCH))))
    assert_stopped(pair, "card-state", "card 'latch' (node 0x13) is in BOOT_UP")


def test_a_card_that_leaves_operational_stops_the_robot(pair) -> None:
    pair.run_to_tick(100)
    pair.bench.receive(Frame(0, bytes((0x02, DAC))))
    # Its outputs are gone before its heartbeat tells: the current says so first.
    assert_stopped(pair, "current-mismatch", "commanded")
    assert "card-state" in [each.detector for each in pair.controller.detections]


def test_a_heartbeat_from_before_nmt_start_that_comes_late_stops_nothing(pair) -> None:
    pair.run_to(State.RUNNING)
    pair.controller.receive(Frame(HEARTBEAT + DAC, b"\x7f"), 0)
    pair.run_to_tick(100)
    assert pair.controller.state is State.RUNNING


def test_a_card_that_does_not_start_stops_the_robot_within_the_heartbeat_time(pair) -> None:
    pair.to_bench = dropping(lambda frame: frame == Frame(0, bytes((0x01, DAC))))
    pair.run_to(State.STOPPING)
    assert pair.controller.tick <= 42
    assert_stopped(pair, "current-mismatch", "commanded")


def test_a_latch_that_does_not_start_is_named(pair) -> None:
    pair.controller.without = {"current-mismatch", "acceleration-mismatch"}
    pair.to_bench = dropping(lambda frame: frame == Frame(0, bytes((0x01, LATCH))))
    pair.run_to(State.STOPPING)
    assert pair.controller.tick <= 42
    assert_stopped(pair, "heartbeat-lost", "card 'latch' (node 0x13) not in OPERATIONAL after NMT start")


def bent_position(pair, code: int) -> Callable[[Frame], Iterable[Frame]]:
    """Joint 2's potentiometer reads `code`."""

    def wire(frame: Frame) -> Iterable[Frame]:
        if frame.can_id == POSITIONS_AND_SPEEDS:
            return (frame._replace(data=struct.pack("<h", code << 7) + frame.data[2:]),)
        return (frame,)

    return wire


@pytest.mark.parametrize(("code", "degrees"), [(0, -135), (255, 135)])
def test_a_position_beyond_the_stops_stops_the_robot(pair, code: int, degrees: int) -> None:
    # 270 degrees on 255 steps, 0 degrees at 2.5 V = 127.5; the stops are at +-130 degrees, the margin is 3.
    pair.run_to_tick(100)
    pair.to_controller = bent_position(pair, code)
    pair.run_to(State.STOPPING)
    assert_stopped(pair, "impossible-position", "joint2 measured at", "-133 to 133 deg")
    assert f"{degrees}.0" in pair.controller.reason or f"{abs(degrees) - 1}.9" in pair.controller.reason


def test_a_step_that_no_joint_can_make_stops_the_robot(pair) -> None:
    pair.run_to_tick(100)
    pair.to_controller = bent_position(pair, 200)  # 76.8 degrees; the joint was near 20
    assert_stopped(pair, "impossible-motion", "joint2 measured", "at most 8 deg")


def test_recording_that_fails_stops_the_robot(pair) -> None:
    def fail() -> None:
        if pair.controller.tick == 100:
            raise OSError(28, "No space left on device")

    pair.controller.on_tick = fail
    assert_stopped(pair, "recording-failed", "No space left on device")


@pytest.mark.parametrize("first", ["recording-failed", "impossible-position"])
def test_a_full_disk_that_takes_no_detection_either_stops_the_robot_once(pair, first: str) -> None:
    """What cannot be told is the end of the run, and no reason to tell it again and again."""

    def full(*anything: object) -> None:
        raise OSError(28, "No space left on device")

    pair.run_to_tick(100)
    pair.controller.on_detection = full
    if first == "recording-failed":
        pair.controller.on_tick = full
    else:
        pair.to_controller = bent_position(pair, 255)
    assert_stopped(pair, first)
    assert pair.controller.detections[0].detector == first
    assert [each.detector for each in pair.controller.detections].count("recording-failed") == 1


# The safe stop itself


def test_after_a_safe_stop_torque_is_off_and_sync_goes_on_until_standstill(make_pair) -> None:
    # Friction four times the nominal: the arm drops, and comes to rest well before the limit of 2 s.
    pair = make_pair(truth={"joint2.coulomb": "0.6", "joint3.coulomb": "0.24", "joint2.viscous": "1.0"})
    pair.run_to_tick(700)
    pair.controller.interrupt("test")
    assert pair.controller.state is State.STOPPING
    stopped_at = pair.controller.tick
    pair.run_until(lambda: pair.controller.tick >= stopped_at + 2)
    assert [joint.command_a for joint in pair.truths[-1].joints] == [0.0, 0.0]
    pair.run_to_end()
    watched = pair.controller.tick - stopped_at
    assert 20 <= watched < 2 * CYCLES_A_SECOND
    # Standstill is three steps of the tachometer, 0.06 rad/s, for 20 cycles.
    assert all(abs(joint.speed_rad_s) < 0.08 for truth in pair.truths[-20:] for joint in truth.joints)
    assert max(abs(joint.speed_rad_s) for truth in pair.truths[stopped_at:] for joint in truth.joints) > 0.1
    assert pair.sent[-6:] == [Frame(0, bytes((command, node_id))) for command in (0x02, 0x80) for node_id in NODES]


@pytest.mark.parametrize("clock", Clock)
def test_a_stop_waits_for_standstill_two_seconds_at_most(make_pair, clock: Clock) -> None:
    pair = make_pair(clock=clock)
    pair.run_to_tick(100)
    pair.to_controller = dropping(lambda frame: frame.can_id == POSITIONS_AND_SPEEDS)
    pair.run_to(State.STOPPING)
    stopped_at = pair.controller.tick
    missed = pair.controller.missed
    pair.run_to_end()
    assert pair.controller.tick - stopped_at == pytest.approx(2 * CYCLES_A_SECOND, abs=1)
    assert pair.controller.missed == missed  # cycles of the stop count for nothing


def test_an_interruption_is_a_safe_stop_with_its_reason(pair) -> None:
    pair.run_to_tick(100)
    pair.controller.interrupt("SIGINT")
    assert_stopped(pair, "interrupted", "SIGINT")


def test_an_interruption_in_bring_up_ends_it_at_once(pair) -> None:
    pair.begin()
    pair.send()
    pair.controller.interrupt("SIGINT")
    assert (pair.controller.state, pair.controller.reason) == (State.FAILED, "interrupted: SIGINT")
    assert pair.controller.deadline_ns is None
    pair.deliver()  # the answer that was awaited comes too late
    assert (pair.controller.state, pair.controller.outbox) == (State.FAILED, [])


def test_the_first_reason_of_a_stop_stands(pair) -> None:
    pair.run_to_tick(100)
    pair.controller.interrupt("first")
    pair.controller.interrupt("second")
    pair.controller.receive(Frame(SYNC), 0)
    assert_stopped(pair, "interrupted", "first")


@pytest.mark.parametrize("clock", Clock)
def test_end_stops_as_planned(make_pair, clock: Clock) -> None:
    pair = make_pair(clock=clock)
    pair.run_to_tick(100)
    pair.controller.end()
    pair.run_to_end()
    assert (pair.controller.state, pair.controller.reason) == (State.DONE, None)
    assert pair.controller.tick <= 104
    assert {slave.state for slave in pair.bench.slaves} == {NmtState.PRE_OPERATIONAL}


def test_end_before_and_during_bring_up_is_an_end_too(make_pair) -> None:
    idle, early = make_pair(), make_pair()
    idle.controller.end()
    assert idle.controller.state is State.DONE
    early.begin()
    early.controller.end()
    early.run_to_end()
    assert (early.controller.state, early.controller.controlled_ticks) == (State.DONE, 0)


def test_a_lost_bus_fails_the_run_at_once_and_nothing_more_is_sent(pair) -> None:
    pair.run_to_tick(100)
    pair.controller.lose(ControllerError("bus lost: gone"))
    assert (pair.controller.state, pair.controller.outbox) == (State.FAILED, [])
    pair.deliver()
    pair.controller.open_cycle()
    assert (pair.controller.state, pair.controller.outbox) == (State.FAILED, [])
    assert pair.controller.reason == "bus lost: gone"


def test_cards_protect_themselves_when_the_controller_is_gone(pair) -> None:
    pair.run_to_tick(400)
    assert any(joint.command_a for joint in pair.bench.world.state())
    pair.controller.lose(ControllerError("gone"))
    pair.bench.run_on()
    assert [joint.command_a for joint in pair.bench.world.state()] == [0.0, 0.0]
    codes = [Emergency.parse(r.frame.data).code for r in pair.bench.records if 0x81 <= r.frame.can_id <= 0xFF]
    assert codes == [0x8130] * 3


# The wall clock, in virtual time


def test_on_the_wall_clock_inputs_close_the_cycle_and_none_is_missed(make_pair) -> None:
    pair = make_pair(clock=Clock.WALL, ticks=400)
    pair.run_to_end()
    assert (pair.controller.state, pair.controller.controlled_ticks, pair.controller.missed) == (State.DONE, 400, 0)


def test_on_the_wall_clock_a_cycle_without_inputs_is_missed_and_controlled_all_the_same(make_pair) -> None:
    pair = make_pair(clock=Clock.WALL, ticks=400)
    pair.run_to_tick(100)
    pair.to_controller = dropping(lambda frame: frame.can_id == CURRENTS and pair.controller.tick in (110, 111, 120))
    pair.run_to_end()
    assert (pair.controller.state, pair.controller.controlled_ticks, pair.controller.missed) == (State.DONE, 400, 3)


@pytest.mark.parametrize("ahead_ns", [-(10**9), -CYCLE_NS, 0, CYCLE_NS, 10**9])
def test_in_lockstep_a_time_object_of_somebody_else_stops_the_robot(pair, ahead_ns: int) -> None:
    pair.run_to_tick(1000)
    pair.controller.receive(time_frame(pair.bench.time_ns + ahead_ns), pair.bench.time_ns)
    assert pair.controller.tick == 1001
    pair.run_to_tick(1004)
    assert pair.controller.state is not State.RUNNING
    assert_stopped(pair, "foreign-master", "TIME that does not belong to this cycle", "another producer of TIME")


def test_a_jump_of_virtual_time_stops_the_robot_and_does_not_hang_it(pair) -> None:
    pair.run_to_tick(100)
    pair.bench.run_on()
    pair.run_to_end()
    assert pair.controller.state is State.FAILED
    assert pair.controller.verdict.detector in ("card-emergency", "foreign-master")


def test_the_wires_delays_are_no_foreign_time(make_pair) -> None:
    pair = make_pair(ticks=800)
    pair.bench = FaultBench(pair.cell, Truth.from_settings(pair.cell, {}), Clock.SYNC, 0, with_wire=True)
    pair.bench.start()
    pair.run_to_end()
    assert (pair.controller.state, pair.controller.missed) == (State.DONE, 0), pair.controller.reason


def test_a_time_object_of_somebody_else_means_nothing_on_the_wall_clock(make_pair) -> None:
    pair = make_pair(clock=Clock.WALL)
    pair.run_to_tick(100)
    pair.controller.receive(Frame(TIME, bytes(6)), 0)
    assert pair.controller.tick == 100


def test_sync_counts_from_1_to_240_and_heartbeats_come_every_20_ms(make_pair) -> None:
    pair = make_pair(ticks=500)
    pair.run_to_end()
    counters = [frame.data[0] for frame in pair.sent if frame.can_id == SYNC]
    assert counters[:242] == [*range(1, 241), 1, 2]
    beats = [frame for frame in pair.sent if frame.can_id == HEARTBEAT + 1]
    assert len(beats) == pytest.approx(len(counters) / 8, abs=2)
