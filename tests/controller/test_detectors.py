"""Every detector finds its fault in time, by its name, and is what finds it: switched off, that name is not said."""

import random
import struct
from collections.abc import Callable, Iterable
from typing import Any

import pytest

from canarm_controller.run.state import State
from canarm_controller.supervision.detection import DETECTORS, Reaction
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import Emergency, Frame
from tests.hooked_law import hook_law

POTENTIOMETER, TACHOMETER, CURRENT_SENSE = 0, 2, 4
"""Place of joint2's channel among the ADC's; joint3's is the next."""
INPUTS, CURRENTS, CODES, LATCH = 0x294, 0x394, 0x312, 0x213
SHIFT = 7  # CiA 401: left-adjusted 16 bits

Distortion = Callable[[int, int], float]
"""From a code and the cycles since the fault began to what is read instead."""


def sensor(pair: Any, channel: int, distortion: Distortion, at: int) -> None:
    """From cycle `at` on, what the ADC's channel reads is distorted."""
    frame_id, place = (INPUTS, channel) if channel < CURRENT_SENSE else (CURRENTS, channel - CURRENT_SENSE)

    def wire(frame: Frame) -> Iterable[Frame]:
        since = pair.controller.tick - at
        if frame.can_id != frame_id or since < 0:
            return (frame,)
        codes = list(struct.unpack(f"<{len(frame.data) // 2}h", frame.data))
        code = round(distortion(codes[place] >> SHIFT, since))
        codes[place] = min(max(code, 0), 255) << SHIFT
        return (frame._replace(data=struct.pack(f"<{len(codes)}h", *codes)),)

    pair.to_controller = wire


def actuator(pair: Any, joint: int, at: int, scale: float = 1.0, turn: dict[int, int] | None = None) -> None:
    """From cycle `at` on, the joint's DAC code is scaled, and its direction bits are turned into others."""
    codes_id, latch_id = (layout.cob_id for node in pair.controller._nodes for layout in node.rpdos)

    def wire(frame: Frame) -> Iterable[Frame]:
        if pair.controller.tick < at or frame.can_id not in (codes_id, latch_id):
            return (frame,)
        if frame.can_id == codes_id:
            codes = list(struct.unpack(f"<{len(frame.data) // 2}h", frame.data))
            codes[joint] = min(round((codes[joint] >> SHIFT) * scale), 255) << SHIFT
            return (frame._replace(data=struct.pack(f"<{len(codes)}h", *codes)),)
        bits = frame.data[0] >> 2 * joint & 0b11
        value = frame.data[0] & ~(0b11 << 2 * joint) | (turn or {}).get(bits, bits) << 2 * joint
        return (frame._replace(data=bytes((value,)) + frame.data[1:]),)

    pair.to_bench = wire


def stuck() -> Distortion:
    """The code of the first cycle, for ever."""
    held: list[int] = []

    def read(code: int, since: int) -> float:
        held.append(code)
        return held[0]

    return read


def noisy(sigma_lsb: float) -> Distortion:
    """White noise on top."""
    source = random.Random(1)
    return lambda code, since: code + source.gauss(0.0, sigma_lsb)


def change(pair: Any, **settings: str) -> None:
    """The true mechanics change; `joint3_mass="0.9"` is `joint3.mass=0.9`."""
    text = {key.replace("_", ".", 1): value for key, value in settings.items()}
    pair.bench.world.change(Truth.from_settings(pair.cell, text))


AT = 1300
"""Joint 2 accelerates at -2.1 rad/s² there, joint 3 turns at -1.7 rad/s, after 3.25 s of the sine."""
IN_TIME = 10
"""25 ms."""
REVERSED = {0b01: 0b10, 0b10: 0b01}
JOINT2, JOINT3 = 0, 1


def sensors(channel: int, distortion: Callable[[], Any]) -> Callable[[Any], None]:
    return lambda pair: sensor(pair, channel, distortion(), AT)


def reading(distortion: Callable[[int, int], float]) -> Callable[[], Any]:
    return lambda: distortion


def overload_then_lag(pair: Any) -> None:
    change(pair, joint3_mass="3.0")


def break_drive(pair: Any) -> None:
    change(pair, joint3_wire="1", joint3_wire_stiffness="1.0")


FAULTS: dict[str, tuple[str, Callable[[Any], None], int]] = {
    "potentiometer-range": ("joint3", sensors(POTENTIOMETER + 1, reading(lambda c, n: 255)), IN_TIME),
    "potentiometer-jump": ("joint2", sensors(POTENTIOMETER, reading(lambda c, n: c + 6)), IN_TIME),
    "potentiometer-spike": ("joint2", sensors(POTENTIOMETER, reading(lambda c, n: c + 6 * (n % 90 == 0))), IN_TIME),
    "potentiometer-stuck": ("joint3", sensors(POTENTIOMETER + 1, stuck), 14 + IN_TIME),
    "potentiometer-mismatch": ("joint2", sensors(POTENTIOMETER, reading(lambda c, n: c + 3)), IN_TIME),
    "impossible-position": ("joint2", sensors(POTENTIOMETER, reading(lambda c, n: 255)), IN_TIME),
    "impossible-motion": ("joint2", sensors(POTENTIOMETER, reading(lambda c, n: c + 20)), IN_TIME),
    "tachometer-range": ("joint2", sensors(TACHOMETER, reading(lambda c, n: 0)), IN_TIME),
    "tachometer-jump": ("joint3", sensors(TACHOMETER + 1, reading(lambda c, n: c + 9)), IN_TIME),
    "tachometer-spike": ("joint3", sensors(TACHOMETER + 1, reading(lambda c, n: c + 9 * (n % 90 == 0))), IN_TIME),
    "tachometer-stuck": ("joint2", sensors(TACHOMETER, stuck), 11 + IN_TIME),
    "tachometer-mismatch": ("joint2", sensors(TACHOMETER, reading(lambda c, n: c + 4)), 200),
    "sensor-noise": ("joint2", sensors(TACHOMETER, lambda: noisy(3.0)), 40),
    "current-sense-mismatch": ("joint2", sensors(CURRENT_SENSE, reading(lambda c, n: 128)), IN_TIME),
    "current-sense-range": ("joint2", sensors(CURRENT_SENSE, reading(lambda c, n: 0)), IN_TIME),
    "current-mismatch": ("joint2", lambda pair: actuator(pair, JOINT2, AT, scale=0.5), IN_TIME),
    "wrong-direction": ("joint2", lambda pair: actuator(pair, JOINT2, AT, turn=REVERSED), 30),
    "acceleration-mismatch": ("joint3", lambda pair: change(pair, joint3_mass="1.2"), 16),
    "following-error": ("joint3", lambda pair: change(pair, joint3_coulomb="90"), 60),
    "saturation": ("joint2", overload_then_lag, 250),
}


MASKED = {
    "saturation": {"following-error", "wrong-direction", "acceleration-mismatch"},
    "following-error": {"acceleration-mismatch", "wrong-direction"},
}
"""Others that stop the robot before this one is due."""


def run(pair: Any, inject: Callable[[Any], None], without: set[str], cycles: int = 260) -> list[Any]:
    """Detections since the fault."""
    pair.controller.without = without
    pair.run_to_tick(AT - 1)
    inject(pair)
    pair.run_until(lambda: pair.controller.tick >= AT + cycles or pair.controller.is_finished)
    return list(pair.controller.detections)


def nominal(make_pair: Any) -> Any:
    return make_pair(law="mras")


@pytest.mark.parametrize("detector", FAULTS)
def test_a_fault_is_found_in_time_and_by_its_name(make_pair, detector: str) -> None:
    where, inject, limit = FAULTS[detector]
    without = MASKED.get(detector, set())
    found = [each for each in run(nominal(make_pair), inject, without) if each.detector == detector]
    assert found, "not detected"
    assert found[0].where == where
    assert 0 <= found[0].tick - AT <= limit


@pytest.mark.slow  # by other faults, test_mutation.py asks the same of every detector
@pytest.mark.parametrize("detector", FAULTS)
def test_it_is_that_detector_which_found_it(make_pair, detector: str) -> None:
    _, inject, _ = FAULTS[detector]
    found = run(nominal(make_pair), inject, {detector} | MASKED.get(detector, set()))
    assert detector not in {each.detector for each in found}


@pytest.mark.parametrize("detector", FAULTS)
def test_what_stops_the_robot_is_what_the_table_says(make_pair, detector: str) -> None:
    _, inject, _ = FAULTS[detector]
    pair = nominal(make_pair)
    found = run(pair, inject, set(DETECTORS) - {detector})
    assert found, "not detected when it is alone"
    assert (pair.controller.state is not State.RUNNING) is DETECTORS[detector].reaction.stops
    if not DETECTORS[detector].reaction.stops:
        assert pair.controller.reason is None
        is_degraded = DETECTORS[detector].reaction in (Reaction.DEGRADED, Reaction.SUBSTITUTE)
        assert bool(pair.controller.degraded) is is_degraded


def test_without_a_fault_nothing_is_detected(make_pair) -> None:
    assert run(nominal(make_pair), lambda pair: None, set(), cycles=800) == []


def test_a_drive_wire_that_breaks_is_found_where_motor_and_joint_part(make_pair) -> None:
    pair = make_pair(law="mras", truth={"joint3.wire": "1"})
    found = run(pair, lambda pair: change(pair, joint3_wire="1", joint3_wire_stiffness="1.0"), set())
    broken = [each for each in found if each.detector == "drive-broken"]
    assert broken[0].where == "joint3"
    assert broken[0].tick - AT <= 40  # the FTTI, 100 ms
    assert broken[0].reaction is Reaction.OFF
    pair = make_pair(law="mras", truth={"joint3.wire": "1"})
    found = run(pair, lambda pair: change(pair, joint3_wire="1", joint3_wire_stiffness="1.0"), {"drive-broken"})
    assert "drive-broken" not in {each.detector for each in found}


@pytest.mark.parametrize("channel", [TACHOMETER, TACHOMETER + 1])
@pytest.mark.parametrize("reads", [0, 128, 255])
def test_a_dead_tachometer_is_replaced_and_the_run_goes_on(make_pair, channel: int, reads: int) -> None:
    pair = nominal(make_pair)
    run(pair, lambda pair: sensor(pair, channel, lambda code, since: reads, AT), set(), cycles=1000)
    lsb_rad = 270.0 / 255 * 3.14159265 / 180
    errors = [
        abs(joint.angle_rad - reference) / lsb_rad
        for joint, reference in zip(pair.truths[-1].joints, pair.controller.loop.cycle.reference_rad, strict=True)
    ]
    assert pair.controller.state is State.RUNNING
    assert max(errors) <= 3.0
    assert {each.reaction for each in pair.controller.degraded} == {Reaction.SUBSTITUTE}


@pytest.mark.parametrize("channel", [POTENTIOMETER, POTENTIOMETER + 1])
@pytest.mark.parametrize("reads", [0, 128, 255])
def test_after_a_dead_potentiometer_the_arm_is_held_and_then_left_without_torque(make_pair, channel: int, reads: int):
    pair = nominal(make_pair)
    pair.run_to_tick(AT - 1)
    sensor(pair, channel, lambda code, since: reads, AT)
    pair.run_to(State.STOPPING)
    before = len(pair.truths)
    pair.run_to_end()
    held = pair.truths[before:-5]
    assert pair.controller.state is State.FAILED
    assert max(abs(joint.speed_rad_s) for truth in held for joint in truth.joints) <= 3.0
    assert max(abs(joint.current_a) for truth in held for joint in truth.joints) <= 1.5
    assert max(abs(joint.speed_rad_s) for joint in held[-1].joints) < 0.3
    assert [joint.command_a for joint in pair.truths[-1].joints] == [0.0, 0.0]


def test_messages_have_detectors_too(make_pair) -> None:
    cases = {
        "card-emergency": Emergency(0x8130, 0x11).frame(0x12),
        "foreign-master": Frame(0x080, b"\x07"),
        "card-state": Frame(0x712, b"\x04"),
    }
    for detector, frame in cases.items():
        for without in (set(), {detector}):
            pair = nominal(make_pair)
            pair.controller.without = without
            pair.run_to_tick(100)
            pair.controller.receive(frame, pair.bench.time_ns)
            assert (detector in {each.detector for each in pair.controller.detections}) is not without.issuperset(
                {detector}
            )


@pytest.mark.parametrize("without", [set(), {"inputs-missing"}])
def test_missing_inputs_are_noted_within_25_ms_and_the_law_goes_on_with_a_prediction(make_pair, without) -> None:
    pair = nominal(make_pair)
    pair.controller.without = without
    pair.run_to_tick(AT)
    pair.to_controller = lambda frame: () if frame.can_id == 0x294 and pair.controller.tick < AT + 12 else (frame,)
    pair.run_to_tick(AT + 200)
    assert pair.controller.state is State.RUNNING
    assert [(each.detector, each.tick - AT) for each in pair.controller.detections] == (
        [] if without else [("inputs-missing", 3)]
    )


@pytest.mark.parametrize("without", [set(), {"inputs-repeated"}])
def test_a_tpdo_twice_in_a_cycle_is_noted(make_pair, without) -> None:
    pair = nominal(make_pair)
    pair.controller.without = without
    pair.run_to_tick(AT)
    pair.to_controller = lambda frame: (frame, frame) if frame.can_id == 0x394 else (frame,)
    pair.run_to_tick(AT + 20)
    names = {(each.detector, each.where) for each in pair.controller.detections}
    assert names == (set() if without else {("inputs-repeated", "0x14")})


@pytest.mark.parametrize("without", [set(), {"inputs-late"}])
def test_a_tpdo_that_comes_a_cycle_late_is_told_from_a_repeated_one(make_pair, without) -> None:
    pair = nominal(make_pair)
    pair.controller.without = without
    pair.run_to_tick(AT)
    kept: list[Frame] = []

    def late(frame: Frame):
        if frame.can_id != 0x394:
            return (frame,)
        if not kept:
            kept.append(frame)
            return ()
        if len(kept) == 1:
            kept.append(frame)
            return (kept[0], frame)
        return (frame,)

    pair.to_controller = late
    pair.run_to_tick(AT + 20)
    assert [each.detector for each in pair.controller.detections] == ([] if without else ["inputs-late"])


@pytest.mark.parametrize("without", [set(), {"deadline-missed"}])
def test_deadlines_that_were_missed_are_noted(make_pair, without) -> None:
    pair = nominal(make_pair)
    pair.controller.without = without
    pair.run_to_tick(50)
    pair.controller.note_missed_deadlines(3)
    assert [(each.detector, each.detail) for each in pair.controller.detections] == (
        [] if without else [("deadline-missed", "3 cycles left out")]
    )
    assert pair.controller.state is State.RUNNING


def test_detections_are_told_as_they_come(make_pair) -> None:
    pair = nominal(make_pair)
    told: list[Any] = []
    pair.controller.on_detection = told.append
    run(pair, FAULTS["tachometer-range"][1], set(), cycles=20)
    assert told == pair.controller.detections
    assert [each.where for each in told] == ["joint2"]


class _Failing:
    """A law's `update` that does what a test wants."""

    def __init__(self, result: Any) -> None:
        self._result = result

    def __call__(self, cycle: Any) -> Any:
        if isinstance(self._result, Exception):
            raise self._result
        return self._result


def _break_law(result: Any) -> Callable[[Any], None]:
    return lambda pair: hook_law(pair.controller.loop, _Failing(result))


def _fail_recording(pair: Any) -> None:
    def full() -> None:
        raise OSError("no space left on device")

    pair.controller.on_tick = full


def _silence_heartbeats(pair: Any) -> None:
    pair.to_controller = lambda frame: () if frame.can_id == 0x714 else (frame,)


def _break_both_sensors(pair: Any) -> None:
    """The tachometer dies first, the potentiometer strays 25 ms later."""
    at = pair.controller.tick + 1

    def wire(frame: Frame) -> Iterable[Frame]:
        if frame.can_id != INPUTS:
            return (frame,)
        codes = list(struct.unpack(f"<{len(frame.data) // 2}h", frame.data))
        codes[TACHOMETER] = 0
        if pair.controller.tick - at > IN_TIME:
            codes[POTENTIOMETER] += 15 << SHIFT
        return (frame._replace(data=struct.pack(f"<{len(codes)}h", *codes)),)

    pair.to_controller = wire


@pytest.mark.parametrize(
    ("detector", "inject"),
    [
        ("law-failed", _break_law(ZeroDivisionError("of the law"))),
        ("law-output", _break_law([float("nan"), 0.0])),
        ("recording-failed", _fail_recording),
        ("heartbeat-lost", _silence_heartbeats),
        ("both-sensors", _break_both_sensors),
        ("interrupted", lambda pair: pair.controller.interrupt("by the user")),
    ],
)
def test_what_is_no_sensor_alone_has_a_detector_that_can_be_switched_off(make_pair, detector: str, inject) -> None:
    pair = nominal(make_pair)
    assert detector in {each.detector for each in run(pair, inject, set(), cycles=100)}
    assert pair.controller.state is not State.RUNNING
    if detector in ("both-sensors", "heartbeat-lost"):
        assert detector not in {each.detector for each in run(nominal(make_pair), inject, {detector}, cycles=100)}
