"""The feed: frames of the bench bus in, snapshots out. Of the cell file: 270 degrees on 255 steps, cycles of 2.5 ms."""

import math

import numpy as np
import pytest

from canarm_protocol.canopen.frames import Frame, NmtState, heartbeat_frame
from canarm_tui.feed import Feed

LSB_RAD = math.radians(270.0 / 255.0)
CYCLE_NS = 2_500_000
RUNNING = 2
"""Of the bench's object 0x2112."""
S = 1_000_000_000


@pytest.fixture
def feed(cell):
    return Feed(cell)


def test_before_any_frame_nothing_is_known(feed):
    snapshot = feed.snapshot(0)
    assert snapshot.age_ns is None
    assert snapshot.cycle is None
    assert snapshot.rates is None
    assert snapshot.report is None
    assert all(math.isnan(joint.angle_rad) for joint in snapshot.joints)
    assert len(snapshot.cycles) == 0


def test_error_is_true_minus_reference_angle_in_steps_of_the_potentiometer(feed, wire):
    feed.receive(wire.telemetry(8, angle_rad=0.3 + 2.0 * LSB_RAD) + wire.reference(8, angle_rad=0.3), 0)
    joint = feed.snapshot(0).joints[0]
    assert joint.error_lsb == pytest.approx(2.0, abs=1e-4)
    assert joint.angle_rad == pytest.approx(0.3 + 2.0 * LSB_RAD, abs=1e-6)
    assert joint.reference_rad == pytest.approx(0.3, abs=1e-6)


@pytest.mark.parametrize("reference_comes_first", [True, False])
def test_a_reference_finds_its_cycle_whichever_comes_first(feed, wire, reference_comes_first):
    telemetry, references = (
        wire.telemetry(8, LSB_RAD),
        [*wire.reference(7, 5.0), *wire.reference(8), *wire.reference(9, 5.0)],
    )
    feed.receive(references + telemetry if reference_comes_first else telemetry + references, 0)
    assert feed.snapshot(0).joints[1].error_lsb == pytest.approx(1.0, abs=1e-4)


def test_a_cycle_without_reference_has_no_error(feed, wire):
    feed.receive(wire.telemetry(8, 1.0) + wire.reference(7) + wire.telemetry(12, 1.0), 0)
    snapshot = feed.snapshot(0)
    assert np.isnan(snapshot.error_lsb).all()
    assert math.isnan(snapshot.joints[0].reference_rad)
    assert snapshot.joints[0].angle_rad == 1.0


def test_angle_and_reference_shown_belong_to_the_same_cycle(feed, wire):
    feed.receive(wire.telemetry(4, 0.25) + wire.reference(4, 0.125) + wire.telemetry(8, 0.5), 0)
    joint = feed.snapshot(0).joints[0]
    assert (joint.angle_rad, joint.reference_rad) == (0.25, 0.125)


def test_the_present_angle_is_shown_when_references_have_ceased_for_half_a_second(feed, wire):
    feed.receive(wire.telemetry(4, 0.25) + wire.reference(4, 0.125) + wire.telemetry(4 + 204, 0.5), 0)
    joint = feed.snapshot(0).joints[0]
    assert joint.angle_rad == 0.5
    assert math.isnan(joint.error_lsb)
    assert joint.rms_lsb == pytest.approx(0.125 / LSB_RAD, rel=1e-5)


def test_rms_and_greatest_error_are_those_of_the_window(feed, wire):
    errors = {0: 3.0, 4000: 1.0, 4004: -2.0}  # 10 s are 4000 cycles: cycle 0 is out of the window
    for cycle, error in errors.items():
        feed.receive(wire.reference(cycle) + wire.telemetry(cycle, error * LSB_RAD), 0)
    snapshot = feed.snapshot(0)
    assert snapshot.cycles.tolist() == [4000, 4004]
    assert snapshot.joints[0].rms_lsb == pytest.approx(math.sqrt((1.0 + 4.0) / 2.0), rel=1e-4)
    assert snapshot.joints[0].max_lsb == pytest.approx(2.0, rel=1e-4)


@pytest.mark.parametrize(("command_a", "sign"), [(1.5, 1), (-1.5, -1), (1.49, 0), (0.0, 0)])
def test_saturation_has_the_sign_of_the_command_at_the_amplifiers_limit(feed, wire, command_a, sign):
    feed.receive(wire.telemetry(0, command_a=command_a), 0)
    assert feed.snapshot(0).joints[0].saturation == sign


def test_age_is_the_wall_time_since_the_last_telemetry_not_since_any_frame(feed, wire):
    feed.receive(wire.telemetry(0), 1_000)
    feed.receive(wire.report(1, 0, 2), 5_000)
    snapshot = feed.snapshot(6_000)
    assert snapshot.age_ns == 5_000
    assert snapshot.report is not None
    assert snapshot.report.age_ns == 1_000


def test_the_controllers_report_is_passed_on(feed, wire):
    feed.receive(wire.report(77, 3, 2), 0)
    report = feed.snapshot(0).report
    assert (report.tick, report.late, report.state) == (77, 3, 2)


def test_rates_tell_bus_time_from_wall_time(feed, wire):
    for cycle in range(0, 801, 4):  # 2 s of the run in 0.5 s of wall time
        feed.receive(wire.telemetry(cycle), round(cycle / 800 * 0.5e9))
    rates = feed.snapshot(500_000_000).rates
    assert rates.cycles_per_s == pytest.approx(400.0)
    assert rates.cycles_per_wall_s == pytest.approx(1600.0)
    assert rates.real_time_factor == pytest.approx(4.0)


def test_rates_end_when_nothing_has_come_for_two_seconds(feed, wire):
    feed.receive(wire.telemetry(0), 0)
    feed.receive(wire.telemetry(4), 10_000_000)
    assert feed.snapshot(20_000_000).rates is not None
    assert feed.snapshot(2_020_000_000).rates is None


def test_frames_are_counted_as_received_unknown_or_malformed(feed, wire):
    status = wire.pdos.status.cob_id
    feed.receive(
        [
            *wire.report(0, 0, 2),
            (0, Frame(0x7FF - 0x100, b"\x01")),
            (0, Frame(status, b"\x01\x02")),
            (0, Frame(status, wire.pdos.status.pack(9), is_extended=True)),
            (0, heartbeat_frame(0x32, NmtState.OPERATIONAL)),
        ],
        0,
    )
    counters = feed.snapshot(0).counters
    assert (counters.received, counters.unknown, counters.malformed) == (5, 2, 1)
    assert feed.snapshot(0).cycle is None


def test_a_sample_that_lacks_a_frame_is_dropped_and_counted(feed, wire):
    feed.receive(wire.telemetry(0) + wire.telemetry(4)[:-1] + wire.telemetry(8), 0)
    snapshot = feed.snapshot(0)
    assert snapshot.counters.dropped_samples == 1
    assert snapshot.cycles.tolist() == [0, 8]


def test_samples_that_never_came_are_counted(feed, wire):
    feed.receive(wire.telemetry(0) + wire.telemetry(16), 0)  # telemetry comes every 4th cycle: 4, 8 and 12 are missing
    assert feed.snapshot(0).counters.dropped_samples == 3


def test_telemetry_between_two_multiples_of_the_divider_hides_no_loss(feed, wire):
    feed.receive(wire.telemetry(4) + wire.telemetry(5) + wire.telemetry(8), 0)
    assert feed.snapshot(0).counters.dropped_samples == 0
    feed.receive(wire.telemetry(9) + wire.telemetry(16), 0)  # 12 is missing
    assert feed.snapshot(0).counters.dropped_samples == 1


def test_while_cycles_stand_still_the_present_angle_is_shown_and_no_error(feed, wire):
    feed.receive(wire.reference(8) + wire.telemetry(8, LSB_RAD), 0)
    feed.receive(wire.telemetry(8, 0.75), 1)
    snapshot = feed.snapshot(1)
    assert snapshot.cycles.tolist() == [8]
    assert (snapshot.joints[0].angle_rad, snapshot.age_ns) == (0.75, 0)
    assert math.isnan(snapshot.joints[0].error_lsb)
    assert snapshot.joints[0].rms_lsb == pytest.approx(1.0, abs=1e-4)
    feed.receive(wire.reference(12) + wire.telemetry(12, LSB_RAD), 2)
    assert feed.snapshot(2).joints[0].error_lsb == pytest.approx(1.0, abs=1e-4)


def test_a_measurement_is_not_shown_beside_an_angle_that_is_not_its_own(feed, wire):
    """A robot that was switched off and on stands elsewhere: until somebody measures there, nothing is measured."""
    measured = wire.pdos.measured[0]

    def cycle(number, angle_rad, measured_rad):
        frame = Frame(measured.cob_id, measured.pack(measured_rad, 0.0))
        return [*wire.telemetry(number, angle_rad), *wire.reference(number), (number * CYCLE_NS, frame)]

    feed.receive(cycle(8, -0.23, -0.22), 0)
    assert feed.snapshot(0).joints[0].measured_rad == pytest.approx(-0.22)
    feed.receive(wire.telemetry(8, 0.35), 1)
    joint = feed.snapshot(1).joints[0]
    assert (joint.angle_rad, math.isnan(joint.measured_rad)) == (pytest.approx(0.35), True)
    feed.receive(cycle(12, 0.35, 0.34), 2)
    assert feed.snapshot(2).joints[0].measured_rad == pytest.approx(0.34)


def test_references_that_never_came_are_counted_for_every_joint(feed, wire):
    feed.receive(wire.reference(10) + wire.reference(13), 0)
    assert feed.snapshot(0).counters.dropped_references == 2 * wire.joints


def test_nothing_counts_as_dropped_over_a_reconnection(feed, wire):
    feed.receive(wire.telemetry(0) + wire.reference(0), 0)
    feed.reconnected()
    feed.receive(wire.telemetry(400) + wire.reference(400), 0)
    counters = feed.snapshot(0).counters
    assert (counters.dropped_samples, counters.dropped_references) == (0, 0)


@pytest.mark.parametrize("is_reconnected", [True, False])
def test_a_cycle_that_goes_backwards_begins_a_new_run(feed, wire, is_reconnected):
    for cycle in range(0, 1200, 4):
        feed.receive(wire.reference(cycle) + wire.telemetry(cycle, 1.0), cycle * 1000)
    if is_reconnected:
        feed.reconnected()
    feed.receive(wire.telemetry(0, 0.5), 2_000_000)
    snapshot = feed.snapshot(2_000_000)
    assert snapshot.cycles.tolist() == [0]
    assert snapshot.joints[0].angle_rad == 0.5
    assert math.isnan(snapshot.joints[0].error_lsb), "matched with a reference of the old run"


def test_references_of_a_new_run_survive_when_they_come_before_its_telemetry(feed, wire):
    feed.receive(wire.telemetry(1200) + wire.reference(1200), 0)
    feed.receive(wire.reference(0) + wire.telemetry(0, LSB_RAD), 0)
    assert feed.snapshot(0).joints[0].error_lsb == pytest.approx(1.0, abs=1e-4)


def test_values_that_are_no_numbers_stay_out_of_the_figures(feed, wire):
    feed.receive(wire.reference(0) + wire.telemetry(0, LSB_RAD), 0)
    feed.receive(wire.reference(4, math.inf) + wire.telemetry(4, math.nan, command_a=math.nan), 0)
    joint = feed.snapshot(0).joints[0]
    assert joint.rms_lsb == pytest.approx(1.0, abs=1e-4)
    assert joint.saturation == 0


def test_what_the_controller_measured_and_its_laws_internals_are_kept_a_joint(feed, wire):
    second = wire.pdos.internals[1][1]
    feed.receive(
        [
            (0, Frame(wire.pdos.measured[1].cob_id, wire.pdos.measured[1].pack(0.5, 0.25))),
            (0, Frame(wire.pdos.command[1].cob_id, wire.pdos.command[1].pack(1.25, 2.0))),
            (0, Frame(second.cob_id, second.pack(3.0, 4.0))),
        ],
        0,
    )
    snapshot = feed.snapshot(0)
    assert snapshot.reported[1].tolist() == [0.5, 0.25, 1.25, 2.0]
    assert snapshot.internals[1, 2:].tolist() == [3.0, 4.0]
    assert np.isnan(snapshot.reported[0]).all()


def test_a_snapshot_does_not_change_afterwards(feed, wire):
    feed.receive(wire.reference(0) + wire.telemetry(0), 0)
    before = feed.snapshot(0)
    feed.receive(wire.reference(4) + wire.telemetry(4, 1.0), 0)
    assert before.cycles.tolist() == [0]
    for array in (before.cycles, before.error_lsb, before.reported, before.internals):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_a_controller_that_was_lost_is_followed_by_another_one(feed, wire):
    feed.receive(wire.telemetry(0) + wire.report(8, 0, RUNNING), 0)
    assert (feed.is_running, feed.controllers) == (True, 1)
    feed.receive(wire.telemetry(400) + wire.report(408, 0, RUNNING), S)
    assert (feed.is_running, feed.controllers) == (True, 1)
    feed.receive(wire.telemetry(412), 3 * S)
    assert feed.is_running, "at a slow pace 16 cycles take their time"
    feed.receive(wire.telemetry(1000), 3 * S + 1)
    assert not feed.is_running
    assert feed.snapshot(3 * S + 1).report.is_lost
    feed.receive(wire.telemetry(1200) + wire.report(1208, 0, RUNNING), 4 * S)
    assert (feed.is_running, feed.controllers) == (True, 2)
    feed.receive(wire.report(8, 0, RUNNING), 4 * S + 1)
    assert feed.controllers == 3, "its ticks begin anew"


@pytest.mark.parametrize("is_reconnected", [True, False])
def test_nothing_is_known_of_a_controller_of_a_new_bench(feed, wire, is_reconnected):
    feed.receive(wire.telemetry(400) + wire.report(408, 0, RUNNING), 0)
    feed.law = "mras"
    if is_reconnected:
        feed.reconnected()
        assert feed.law == ""
    feed.receive(wire.telemetry(0), 3 * S)
    assert feed.snapshot(3 * S).report is None
