"""The bench's own judgement of a run, against the same figures computed by numpy from whole histories."""

import math
import struct

import numpy as np
import pytest

from canarm_emulator.bench_node.assessor import KEPT_CYCLES, SETTLING_CYCLES, SHORTEST_STRETCH, Assessor, SpeedRipple
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import JointState
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.canopen.sdo import download, upload
from canarm_protocol.cell.bench_objects import bench_pdos
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock

CELL = load_cell("konkuk1")
LSB_RAD = math.radians(270.0 / 255)
PERIOD_S = CELL.bus.cycle_s
CYCLES = 3000
UNLIMITED = [0, 0]


def state(
    angle_rad: float = 0.0, speed_rad_s: float = 0.0, current_a: float = 0.0, command_a: float = 0.0
) -> JointState:
    return JointState(angle_rad, speed_rad_s, current_a, command_a, angle_rad, speed_rad_s)


def run(truth: np.ndarray, reference: np.ndarray, delay: int = 0) -> Assessor:
    """An assessor that saw `truth` (cycle, joint, angle/speed/current/command), the reference `delay` cycles late."""
    assessor = Assessor(CELL)
    assessor.begin()
    for cycle in range(len(truth) + delay):
        if cycle < len(truth):
            assessor.truth(cycle, [state(*map(float, joint)) for joint in truth[cycle]], UNLIMITED)
        if cycle >= delay:
            for joint in range(2):
                assessor.reference(cycle - delay, joint, float(reference[cycle - delay, joint]))
    return assessor


@pytest.fixture(scope="module")
def history() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    return rng.normal(0.0, 1.0, (CYCLES, 2, 4)), rng.normal(0.0, 0.3, (CYCLES, 2))


@pytest.mark.parametrize("delay", [0, 500])
def test_errors_are_those_of_numpy_with_the_settling_left_out(history, delay: int) -> None:
    truth, reference = history
    scores = run(truth, reference, delay).scores
    errors = (truth[SETTLING_CYCLES:, :, 0] - reference[SETTLING_CYCLES:]) / LSB_RAD
    assert [score.samples for score in scores] == [CYCLES - 1024] * 2
    assert [score.rms_lsb for score in scores] == pytest.approx(np.sqrt(np.mean(errors**2, axis=0)))
    assert [score.max_lsb for score in scores] == pytest.approx(np.abs(errors).max(axis=0))


def test_peak_current_and_saturation_are_of_the_whole_run(history) -> None:
    truth, reference = history
    scores = run(truth, reference).scores
    assert [score.peak_current_a for score in scores] == pytest.approx(np.abs(truth[:, :, 2]).max(axis=0))
    assert [score.saturated_cycles for score in scores] == (np.abs(truth[:, :, 3]) >= 1.5).sum(axis=0).tolist()


def test_full_scale_of_the_dac_counts_as_saturated() -> None:
    assessor = Assessor(CELL)
    for command_a in (1.5, -1.5, 1.5 * 254 / 255, -1.5 * 254 / 255):
        assessor.truth(0, [state(command_a=command_a)] * 2, UNLIMITED)
    assert assessor.scores[0].saturated_cycles == 2


def test_a_cycle_in_which_the_supply_held_the_current_down_counts_as_saturated() -> None:
    assessor = Assessor(CELL)
    for cycle, limited_steps in enumerate(([0, 0], [4, 0], [4, 0], [5, 1])):
        assessor.truth(cycle, [state(), state()], limited_steps)
    assert [score.saturated_cycles for score in assessor.scores] == [2, 1]


def test_a_reference_is_dropped_when_it_is_of_no_cycle_that_is_kept() -> None:
    assessor = Assessor(CELL)
    for cycle in range(SETTLING_CYCLES + KEPT_CYCLES + 10):
        assessor.truth(cycle, [state(), state()], UNLIMITED)
    latest = SETTLING_CYCLES + KEPT_CYCLES + 9
    for tick in (SETTLING_CYCLES - 1, SETTLING_CYCLES + 9, latest + 1, latest + KEPT_CYCLES, 2**32 - 1):
        assessor.reference(tick, 0, 1.0)
    assert assessor.scores[0].samples == 0
    for tick in (latest, SETTLING_CYCLES + 10):
        assessor.reference(tick, 0, 1.0)
    assert assessor.scores[0].samples == 2


@pytest.mark.parametrize("angle_rad", [math.nan, math.inf, -math.inf, 3e38])
def test_a_reference_that_is_no_angle_is_dropped(angle_rad: float) -> None:
    assessor = Assessor(CELL)
    assessor.truth(SETTLING_CYCLES, [state(), state()], UNLIMITED)
    assessor.reference(SETTLING_CYCLES, 0, angle_rad)
    assert (assessor.scores[0].samples, assessor.scores[0].rms_lsb) == (0, 0.0)


def test_a_new_run_begins_with_nothing(history) -> None:
    assessor = run(*history)
    assessor.begin()
    assessor.reference(CYCLES - 1, 0, 0.0)
    assert [(s.samples, s.rms_lsb, s.max_lsb, s.peak_current_a, s.speed_ripple) for s in assessor.scores] == [
        (0, 0, 0, 0, 0)
    ] * 2


# Speed ripple


def ripple(references: np.ndarray, speeds: np.ndarray) -> float:
    judge = SpeedRipple()
    for angle_rad, speed_rad_s in zip(references.tolist(), speeds.tolist(), strict=True):
        judge.add(angle_rad, speed_rad_s)
    return judge.value


def ramp(count: int, speed_rad_s: float, start_rad: float = 0.0) -> np.ndarray:
    return start_rad + speed_rad_s * PERIOD_S * np.arange(count)


def test_ripple_of_one_stretch_is_standard_deviation_over_mean() -> None:
    """The speed of a stretch is known from its second step on: the first two samples only begin it."""
    speeds = np.random.default_rng(1).normal(0.5, 0.02, 400)
    assert ripple(ramp(400, 0.5), speeds) == pytest.approx(np.std(speeds[2:]) / np.mean(speeds[2:]))


def test_ripple_of_going_there_and_back_pools_the_stretches_about_their_own_means() -> None:
    rng = np.random.default_rng(2)
    stretches = [rng.normal(mean, 0.03, count) for mean, count in ((0.5, 400), (-0.4, 300), (0.5, 200))]
    references = [np.zeros(1)]
    for mean, speeds in zip((0.5, -0.4, 0.5), stretches, strict=True):
        references.append(ramp(speeds.size, mean, references[-1][-1]))
    used = [speeds[2:] for speeds in stretches]  # a corner's angle comes twice, and the step after it is new
    count = sum(speeds.size for speeds in used)
    deviation = math.sqrt(sum(speeds.var() * speeds.size for speeds in used) / count)
    mean = sum(abs(speeds.sum()) for speeds in used) / count
    assert ripple(np.concatenate(references[1:]), np.concatenate(stretches)) == pytest.approx(deviation / mean)


def test_there_is_no_ripple_without_a_stretch_of_constant_speed() -> None:
    angles = np.sin(np.arange(2000) * PERIOD_S * 5.0)
    assert ripple(angles, np.ones(2000)) == 0.0
    assert ripple(np.full(2000, 0.3), np.random.default_rng(3).normal(size=2000)) == 0.0
    short = SHORTEST_STRETCH + 1
    assert ripple(ramp(short, 0.5), np.linspace(0.4, 0.6, short)) == 0.0
    assert ripple(ramp(short + 1, 0.5), np.linspace(0.4, 0.6, short + 1)) > 0.0


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_slow_swing_has_no_stretch_of_constant_speed(dtype: type) -> None:
    """A raised cosine of 20° and 10 s accelerates by at most 0.069 rad/s², 4e-7 rad in a cycle squared."""
    time_s = np.arange(8000) * PERIOD_S
    angles = math.radians(10.0) * (1.0 - np.cos(2.0 * math.pi * time_s / 10.0))
    assert ripple(angles.astype(dtype).astype(float), np.linspace(0.0, 1.0, 8000)) == 0.0


@pytest.mark.parametrize("angles_rad", [ramp(2000, 0.004), 0.002 * (1.0 - np.cos(np.arange(10_000) * PERIOD_S / 4.0))])
def test_a_joint_that_hardly_moves_has_no_ripple(angles_rad: np.ndarray) -> None:
    """Its share of a mean speed of nearly nothing would be thousands of percent."""
    speeds = np.random.default_rng(5).normal(0.001, 0.03, len(angles_rad))
    assert ripple(angles_rad, speeds) == 0.0


def test_a_reference_in_single_precision_is_still_steady() -> None:
    speeds = np.random.default_rng(4).normal(0.5, 0.02, 800)
    references = ramp(800, 0.5, start_rad=1.2).astype(np.float32).astype(float)
    assert ripple(references, speeds) == pytest.approx(np.std(speeds[2:]) / np.mean(speeds[2:]))


# Over the bench bus


def read(bench: FaultBench, index: int, subindex: int, format_: str) -> float:
    """One expedited SDO upload from the bench node."""
    transfer = upload(index, subindex)
    bench.receive_bench(Frame(0x670, next(transfer)))
    with pytest.raises(StopIteration) as done:
        transfer.send(bench.bench_records[-1].frame.data)
    return struct.unpack(format_, done.value.value)[0]


@pytest.fixture(scope="module")
def assessed() -> tuple[FaultBench, np.ndarray, np.ndarray, np.ndarray]:
    """A bench after a run whose references came by RPDO, every fourth cycle as a controller sends them."""
    bench = FaultBench(CELL, Truth.from_settings(CELL, {}), Clock.SYNC, seed=3)
    bench.start()
    pdos, truth, references, limited = bench_pdos(CELL), [], [], [[0, 0]]
    bench.on_cycle = lambda cycle: (
        truth.append(list(cycle.joints)),
        limited.append([steps.supply for steps in bench.world.saturated_steps]),
    )
    bench.receive(nmt_frame(NmtCommand.START))
    for cycle in range(SETTLING_CYCLES + 400):
        bench.receive(Frame(0x312, struct.pack("<2h4x", 40 + cycle % 32 << 7, 20 << 7)))
        bench.receive(Frame(0x213, bytes((0b0110 if cycle // 64 % 2 else 0b1001,))))
        bench.receive(sync_frame(None))
        references.append([np.float32(0.3 + 1e-4 * cycle), np.float32(-0.1)])
        if cycle % 4 == 3:
            for tick in range(cycle - 3, cycle + 1):
                for joint in range(2):
                    layout = pdos.reference[joint]
                    bench.receive_bench(Frame(layout.cob_id, layout.pack(tick, references[tick][joint])))
        bench.records.clear()
    return bench, np.array(truth), np.array(references, dtype=float), np.diff(limited, axis=0) > 0


def test_figures_read_by_sdo_are_those_of_numpy(assessed) -> None:
    bench, truth, references, limited = assessed
    errors = (truth[SETTLING_CYCLES:, :, 0] - references[SETTLING_CYCLES:]) / LSB_RAD
    rms, highest = np.sqrt(np.mean(errors**2, axis=0)), np.abs(errors).max(axis=0)
    for joint in (0, 1):
        assert read(bench, 0x2200, joint + 1, "<f") == pytest.approx(rms[joint], rel=1e-6)
        assert read(bench, 0x2201, joint + 1, "<f") == pytest.approx(highest[joint], rel=1e-6)
        assert read(bench, 0x2202, joint + 1, "<f") == pytest.approx(np.abs(truth[:, joint, 2]).max(), rel=1e-6)
        assert read(bench, 0x2203, joint + 1, "<I") == limited[:, joint].sum()
    assert limited.any()  # the arm falls about faster than a motor can follow
    speeds = truth[SETTLING_CYCLES + 2 :, 0, 1]
    assert read(bench, 0x2204, 1, "<f") == pytest.approx(abs(np.std(speeds) / np.mean(speeds)), rel=1e-5)
    assert read(bench, 0x2204, 2, "<f") == 0.0
    assert read(bench, 0x2210, 0, "<I") == 400


def test_truth_and_report_can_be_read_by_sdo(assessed) -> None:
    bench, truth, references, _ = assessed
    assert read(bench, 0x2001, 0, "<I") == SETTLING_CYCLES + 399
    for subindex in (1, 2):
        for column, index in enumerate((0x2100, 0x2101, 0x2102, 0x2103)):
            assert read(bench, index, subindex, "<f") == pytest.approx(truth[-1, subindex - 1, column], rel=1e-6)
        assert read(bench, 0x2120, subindex, "<f") == references[-1, subindex - 1]
    assert read(bench, 0x2110, 0, "<I") == SETTLING_CYCLES + 399


def test_the_controllers_report_is_kept_as_it_came() -> None:
    bench = FaultBench(CELL, Truth.from_settings(CELL, {}), Clock.SYNC, seed=0)
    bench.start()
    pdos = bench_pdos(CELL)
    for layout, values in (
        (pdos.controller, (77, 5, 2)),
        (pdos.measured[1], (0.5, -0.25)),
        (pdos.command[0], (1.5, -2.0)),
        (pdos.internals[1][1], (3.0, 4.0)),
    ):
        bench.receive_bench(Frame(layout.cob_id, layout.pack(*values)))
        found = [read(bench, m.index, m.subindex, "<" + m.format) for m in layout.objects]
        assert found == list(values)
    bench.receive_bench(Frame(0x670, next(download(0x2120, 2, struct.pack("<f", 0.5)))))
    assert read(bench, 0x2120, 2, "<f") == 0.5
