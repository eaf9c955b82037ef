"""The controller's report to the bench, decoded as the bench decodes it."""

import math
import struct
from collections import Counter

import pytest

from canarm_controller.run.report import BenchReport
from canarm_controller.run.state import State
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.bench_objects import bench_pdos
from canarm_protocol.faults.detection_events import Pieces


@pytest.fixture
def reported(make_pair):
    """A pair whose ticks are reported, its report, and a list of (tick, cycle's values) as they were."""
    pair = make_pair(law="mras")
    report = BenchReport(pair.cell, pair.controller)
    seen = []

    def tick() -> None:
        report.tick()
        cycle = pair.controller.loop.cycle
        internals = {name: list(values) for name, values in pair.controller.loop.internals().items()}
        seen.append(
            (cycle.tick, cycle.reference_rad, cycle.position_rad, cycle.applied_nm, cycle.feedforward_nm, internals)
        )

    pair.controller.on_tick = tick
    return pair, report, seen


def test_every_tick_has_its_reference_of_every_joint(reported) -> None:
    pair, report, seen = reported
    pair.run_to_tick(40)
    frames, pdos = report.take(everything=True), bench_pdos(pair.cell)
    for joint, layout in enumerate(pdos.reference):
        rows = [layout.unpack(frame.data) for frame in frames if frame.can_id == layout.cob_id]
        assert [tick for tick, _ in rows] == list(range(40))
        assert [angle for _, angle in rows] == pytest.approx([row[1][joint] for row in seen], abs=1e-7)


def test_every_eighth_tick_has_measurement_command_and_internals(reported) -> None:
    pair, report, seen = reported
    pair.run_to_tick(40)
    frames, pdos = report.take(everything=True), bench_pdos(pair.cell)
    eighth = [row for row in seen if row[0] % 8 == 0]
    assert len(eighth) == 5

    def decoded(layout):
        return [layout.unpack(frame.data) for frame in frames if frame.can_id == layout.cob_id]

    per_ampere = [0.08 * 60 * 0.85, 0.08 * 40 * 0.85]  # K_I of konkuk1's joints: 4.08 and 2.72 N m/A
    for joint in range(2):
        measured = decoded(pdos.measured[joint])
        assert [angle for angle, _ in measured] == pytest.approx([row[2][joint] for row in eighth], abs=1e-6)
        command = decoded(pdos.command[joint])
        assert [a for a, _ in command] == pytest.approx([row[3][joint] / per_ampere[joint] for row in eighth], abs=1e-6)
        assert [nm for _, nm in command] == pytest.approx([row[4][joint] for row in eighth], abs=1e-6)
        first, second = (decoded(layout) for layout in pdos.internals[joint])
        for name, values in zip(
            ("alpha", "beta", "bias_a", "model_rad"),
            ([x for x, _ in first], [y for _, y in first], [x for x, _ in second], [y for _, y in second]),
            strict=True,
        ):
            assert values == pytest.approx([row[5][name][joint] for row in eighth], rel=1e-6, abs=1e-7)


def test_the_state_and_the_missed_cycles_are_reported(reported) -> None:
    pair, report, _ = reported
    pair.run_to_tick(20)
    pair.controller.missed = 70_000
    frames, layout = report.take(everything=True), bench_pdos(pair.cell).controller
    assert layout.unpack(frames[-1].data) == (20, 65_535, State.RUNNING)


def test_frames_go_out_in_batches_of_16_ticks(reported) -> None:
    pair, report, _ = reported
    batches = []
    tell = pair.controller.on_tick

    def tick() -> None:
        tell()
        frames = report.take()
        if frames:
            batches.append(Counter(frame.can_id for frame in frames)[bench_pdos(pair.cell).reference[0].cob_id])

    pair.controller.on_tick = tick
    pair.run_to_tick(160)
    assert batches == [16] * 10
    assert report.take() == []


def test_the_bench_judges_from_the_report_what_the_rig_judges_from_the_reference(reported) -> None:
    pair, report, _ = reported
    sums = [0.0, 0.0]
    count = 0
    tell = pair.controller.on_tick

    def tick() -> None:
        nonlocal count
        tell()
        cycle, truth = pair.controller.loop.cycle, pair.truths[-1]
        assert truth.cycle == cycle.tick
        if cycle.tick >= 1024:  # settling
            count += 1
            for joint in range(2):
                step_rad = math.radians(270.0) / 255
                sums[joint] += ((truth.joints[joint].angle_rad - cycle.reference_rad[joint]) / step_rad) ** 2
        for frame in report.take():
            pair.bench.receive_bench(frame, report)

    pair.controller.on_tick = tick
    pair.run_to_tick(2048)
    for frame in report.take(everything=True):
        pair.bench.receive_bench(frame, report)
    scores = pair.bench.assessor.scores
    assert [score.samples for score in scores] == [count] * 2 == [1024] * 2
    assert [score.rms_lsb for score in scores] == pytest.approx([math.sqrt(total / count) for total in sums], rel=1e-4)


@pytest.mark.parametrize(
    ("value", "reported_value"), [(1e300, math.inf), (-1e300, -math.inf), (math.inf, math.inf), (3.4e38, 3.4e38)]
)
def test_an_inner_value_that_runs_away_is_reported_as_infinite(reported, value: float, reported_value: float) -> None:
    pair, report, _ = reported
    pair.run_to_tick(8)
    report.take(everything=True)
    loop = pair.controller.loop
    runaway = {name: [value, math.nan] for name in loop.internal_names}
    loop.law.internals = lambda: runaway
    pair.run_to_tick(9)  # a law is asked once per cycle
    report.take(everything=True)
    report.tick()
    report.tick()
    loop.cycle.tick = 8
    report.tick()
    frames = report.take(everything=True)
    first, second = (pdos[0] for pdos in bench_pdos(pair.cell).internals)
    by_id: dict[int, Frame] = {frame.can_id: frame for frame in frames}
    assert struct.unpack("<ff", by_id[first.cob_id].data) == pytest.approx((reported_value, reported_value), rel=1e-6)
    assert math.isnan(struct.unpack("<ff", by_id[second.cob_id].data)[0])


def test_a_detection_leaves_at_once_and_once(reported) -> None:
    pair, report, _ = reported
    pair.run_to_tick(40)
    layout = bench_pdos(pair.cell).detection
    report.take(everything=True)
    pair.controller._detect("acceleration-mismatch", "joint2", "joint2: 40 rad/s²", None)
    pair.run_to_tick(41)
    pieces = Pieces()
    sent = [frame for frame in (*report.take(), *report.take(everything=True)) if frame.can_id == layout.cob_id]
    heard = [event for frame in sent if (event := pieces.take(*layout.unpack(frame.data))) is not None]
    (event,) = heard
    assert (event.detector, event.where, event.detail) == ("acceleration-mismatch", "joint2", "joint2: 40 rad/s²")
    assert event.cycle in (39, 40)
