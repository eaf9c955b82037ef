"""The cell of two RHINO robots: published figures, its bus, and the paper's circle with the object in both hands."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from canarm import Rig, State
from canarm.cooperation import RHINO_XR, CarriedObject, circle, forward, pair_of, plan_cooperation
from canarm.soundness import unsound
from canarm.usage import UsageError
from canarm_controller.dynamics import nominal_arm
from canarm_controller.errors import TrajectoryError
from canarm_controller.reference.trajectory import make_trajectory
from canarm_emulator.errors import TruthError
from canarm_protocol.cell import load_cell
from canarm_protocol.cell.schedulability import cell_messages, cell_verdict
from canarm_protocol.cell.sensing import position_steps_rad

CELL = load_cell("rhino-pair")
MASTER, SLAVE = CELL.robot
PAIR = pair_of(MASTER, SLAVE, CarriedObject(length_m=0.6))
START = np.radians([joint.home_deg for joint in MASTER.joint])
NAMES = [f"{robot.name}_{joint.name}" for robot in CELL.robot for joint in robot.joint]


def test_both_arms_are_rhinos_and_parked_where_the_papers_circle_begins() -> None:
    for arm in (PAIR.master, PAIR.slave):
        assert (arm.d_m, arm.a_m, arm.alpha_deg) == (RHINO_XR.d_m, RHINO_XR.a_m, RHINO_XR.alpha_deg)
    plan = plan_cooperation(PAIR, circle(), START)
    np.testing.assert_allclose(np.degrees(plan.slave_rad[0]), [joint.home_deg for joint in SLAVE.joint], atol=1e-3)


@pytest.mark.parametrize(
    ("decoding", "published"), [(1, (4.4, 8.7, 8.7, 8.7, 3.2)), (4, (17.5, 34.9, 34.9, 34.9, 12.8))]
)
def test_encoders_count_as_published(decoding: int, published: tuple[float, ...]) -> None:
    """Counts a degree of the Mark III, and of the Mark IV, which counts every edge."""
    cards = tuple(
        card.model_copy(update={"decoding": decoding} if "counter" in card.name else {}) for card in CELL.card
    )
    cell = CELL.model_copy(update={"card": cards})
    np.testing.assert_allclose(np.radians(1.0) / np.array(position_steps_rad(cell)), published * 2, rtol=0.01)


def test_no_drive_holds_more_than_half_of_its_current_along_the_circle() -> None:
    plan = plan_cooperation(PAIR, circle(), START)
    for robot, path in ((MASTER, plan.master_rad), (SLAVE, plan.slave_rad)):
        arm = nominal_arm(robot)
        held_a = np.array([arm.gravity(q.tolist()) for q in path[::50]]) / np.array(arm.torque_per_ampere)
        assert np.abs(held_a).max() < 0.5 * 1.5
    assert np.abs(held_a).max() > 0.4 * 1.5  # the slave's shoulder


def test_what_ten_joints_say_every_cycle_fits_the_bus() -> None:
    """SYNC with its counter; TPDOs of 2 + 2 + 1 counts, RPDOs of 4 + 1 currents and of 4 + 1 directions, each robot.

    And heartbeats, by which a card that only listens is missed within 20 ms; and an error value that is written anew,
    a request and an answer of eight bytes, every 10 ms.
    """

    def frame(data_bytes: int) -> int:
        """Standard frame with worst-case stuffing and intermission."""
        return 8 * data_bytes + 44 + (34 + 8 * data_bytes - 1) // 4 + 3

    assert [frame(length) for length in (8, 4, 2, 1)] == [135, 95, 75, 65]
    every_cycle = frame(1) + 6 * frame(8) + 2 * frame(4) + 2 * frame(2) + 4 * frame(1)
    messages = [message for message in cell_messages(CELL) if message.period_ns == CELL.bus.cycle_ns]
    assert sum(message.bits for message in messages) == every_cycle == 1475
    verdict = cell_verdict(CELL)
    assert verdict.fits
    beats = 13 * frame(1) / 7000  # of twelve cards and a controller, in bits a microsecond
    assert verdict.load == pytest.approx(every_cycle / 2500 + beats + 2 * frame(8) / 10_000)
    assert verdict.load < 0.75


def on_the_path(rig: Rig) -> int:
    """The cycle at which the path has been begun for half a second: homing and the move to it are over."""
    return round((rig.approach_s + 0.5) / CELL.bus.cycle_s)


def tip_errors_mm(rig: Rig) -> tuple[float, float]:
    """RMS distance of the master's tip from its reference, and of the slave's, along the path."""
    begins = on_the_path(rig)

    def both(signal: str) -> tuple[np.ndarray, np.ndarray]:
        angles = np.array([getattr(joint, signal)[begins:] for joint in rig.joints.values()]).T
        return forward(PAIR.master, angles[:, :5])[:, :3, 3], forward(PAIR.slave, angles[:, 5:])[:, :3, 3]

    pairs = zip(both("true_angle_rad"), both("reference_rad"), strict=True)
    master, slave = (float(np.sqrt(((true - meant) ** 2).sum(axis=1).mean())) * 1e3 for true, meant in pairs)
    return master, slave


@pytest.mark.parametrize(
    ("law", "truth"),
    [
        ("mras", {}),
        pytest.param("mras", {"object.mass": 0.6}, marks=pytest.mark.slow),
        pytest.param("mras-lyapunov", {}, marks=pytest.mark.slow),
        pytest.param("mras-lyapunov", {"object.mass": 0.6}, marks=pytest.mark.slow),
        pytest.param("slotine-li", {}, marks=pytest.mark.slow),
        pytest.param("slotine-li", {"object.mass": 0.6}, marks=pytest.mark.slow),
    ],
)
def test_two_robots_carry_the_object_round_the_papers_circle(law: str, truth: dict[str, float]) -> None:
    """One lap in 5 s, a count of the encoders is 0.4 mm and more at the tip; also with half as much weight again."""
    with Rig("rhino-pair", law=law, truth=truth) as rig:
        rig.run(seconds=10.0)
        assert rig.state is State.RUNNING
        assert not rig.detections
        assert 3.0 < rig.approach_s < 5.0
        master, slave = tip_errors_mm(rig)
        carried = rig.object
        assert master < 0.5
        assert slave < 0.5
        assert carried.is_held
        assert np.sqrt((carried.squeeze_n**2).mean()) < 1.0
        assert np.abs(carried.squeeze_n).max() < 4.0
        assert carried.grip_force_n.max() < carried.slip_force_n / 2
        way = np.ptp(carried.position_m[on_the_path(rig) :], axis=0)
        assert way[1:] == pytest.approx([0.0254, 0.0254], abs=0.0015)  # twice the radius
        assert set(rig.robots["slave"]) == {"waist", "shoulder", "elbow", "pitch", "roll"}
        figures = rig.summary().object
        assert figures is not None
        assert figures["grip_peak_n"] < carried.slip_force_n / 2


def wrong(seed: int) -> dict[str, float]:
    """A heavier object, joints parked up to half a count off, the slave's base 0.6 mm off, more friction."""
    draw = np.random.default_rng(seed)
    off_m = draw.normal(size=3)
    off_m *= 0.0006 / np.linalg.norm(off_m)
    truth = {"object.mass": 0.6, **{f"object.base_{axis}": float(off) for axis, off in zip("xyz", off_m, strict=True)}}
    half_counts_deg = 0.5 * np.degrees(position_steps_rad(CELL))
    parked = draw.uniform(-1.0, 1.0, len(NAMES)) * half_counts_deg
    for name, joint, off_deg in zip(CELL.joint_names, CELL.joints, parked.tolist(), strict=True):
        truth[f"{name}.initial_deg"] = joint.home_deg + off_deg
        truth[f"{name}.coulomb"] = 1.3 * joint.motor.coulomb_friction_nm
        truth[f"{name}.viscous"] = 1.3 * joint.motor.viscous_friction_nm_s
    return truth


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4])
@pytest.mark.parametrize("law", ["mras", "mras-lyapunov", "slotine-li"])
def test_with_everything_wrong_at_once_the_object_is_carried_as_well(law: str, seed: int) -> None:
    """Homed first; without that a count of a joint would be half a millimetre at the tip, which no encoder sees."""
    with Rig("rhino-pair", law=law, truth=wrong(seed)) as rig:
        rig.run(seconds=10.0)
        assert rig.state is State.RUNNING
        assert not rig.detections
        master, slave = tip_errors_mm(rig)
        carried = rig.object
        squeeze_n = carried.squeeze_n[on_the_path(rig) :]
        assert master < 0.8
        assert slave < 0.8
        assert np.sqrt((squeeze_n**2).mean()) < 1.0
        assert np.abs(carried.squeeze_n).max() < 4.0
        figures = rig.summary().object
        assert figures is not None
        assert figures["grip_peak_n"] < carried.slip_force_n / 2  # in every step of the integration, from power-on


@pytest.mark.parametrize(
    ("tap", "fault"),
    [
        pytest.param("master_waist.encoder", "drift", marks=pytest.mark.slow),
        pytest.param("slave_pitch.encoder", "dropout", marks=pytest.mark.slow),
    ],
)
def test_an_encoder_that_lies_beyond_all_reason_ends_in_a_stop_and_in_finite_speeds(tap: str, fault: str) -> None:
    """Centrifugal forces of speeds that nothing can have would make more of them, cycle after cycle."""
    with Rig("rhino-pair") as rig:
        rig.inject(tap, fault, at=5.0)
        rig.run(seconds=7.0)
        rig.finish()
        assert str(rig.reason).startswith("impossible-")
        assert np.isfinite(rig.controller.loop.cycle.velocity_rad_s).all()
        assert rig.object.is_held


def test_a_lost_object_is_an_event_and_in_the_summary(tmp_path: Path) -> None:
    with Rig("rhino-pair", truth={"object.slip_force": 3.0}, out=tmp_path / "run") as rig:
        rig.run(seconds=0.2)
        assert not rig.object.is_held
        assert [event.detail for event in rig.events if event.event == "grip-lost"] == ["master", "slave"]
        assert "lost by the master, lost by the slave" in rig.summary().as_text()
    events = [json.loads(line) for line in (tmp_path / "run" / "events.jsonl").read_text().splitlines()]
    assert [each["hand"] for each in events if each["event"] == "grip-lost"] == ["master", "slave"]
    header = (tmp_path / "run" / "signals" / "robot.csv").read_text().partition("\n")[0].split(",")
    assert {"object.position_x_m", "object.slave_force_z_n", "object.squeeze_n"} <= set(header)


def test_a_cell_without_an_object_says_so() -> None:
    with Rig("konkuk1") as rig:
        rig.run(seconds=0.01)
        with pytest.raises(UsageError, match="cell 'konkuk1' has no object"):
            _ = rig.object
        assert rig.summary().object is None
        assert "object" not in rig.summary().as_json()


def test_joints_that_would_tear_the_object_apart_are_refused() -> None:
    plan = plan_cooperation(PAIR, circle(ease_s=1.0), START)
    assert make_trajectory(plan.columns(NAMES), CELL).amplitude_rad[0] > 0.0
    torn = plan.columns(NAMES)
    torn["slave_waist"] = torn["slave_waist"] + np.linspace(0.0, 2.0, len(torn["slave_waist"]))
    with pytest.raises(TrajectoryError, match=r"trajectory: row \d+: the slave's hand is .* mm from where it holds"):
        make_trajectory(torn, CELL)
    with pytest.raises(TrajectoryError, match="built in here: circle, line, arc"):
        make_trajectory("sine", CELL)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("circle:radius=3", "no option 'radius'; there are laps, seconds, radius_mm, plane, start_deg"),
        ("circle:radius_mm=much", "radius_mm=much: must be a number"),
        ("circle:plane=yy", "plane 'yy'; must be one of"),
        ("line:laps=0", "laps=0: must be positive"),
        ("line:x_mm", "'x_mm': must be KEY=VALUE"),
        ("line:x_mm=1,x_mm=2", "each key once"),
        ("circle:radius_mm=300", "singular"),
        ("circel", "did you mean 'circle'"),
    ],
)
def test_a_path_that_cannot_be_followed_says_why(name: str, message: str) -> None:
    with pytest.raises(TrajectoryError, match=re.escape(message)):
        make_trajectory(name, CELL)


def test_other_paths_and_a_file_of_the_tips_way(tmp_path: Path) -> None:
    """An arc and a line end where they should; a file has positions in the master's base."""

    def end(spec: str, seconds: float) -> np.ndarray:
        reference = make_trajectory(spec, CELL).sample(0, round(seconds / 0.0025), 0.0025).position_rad
        tip = forward(PAIR.master, reference[:, :5])[:, :3, 3]
        return np.asarray(tip[-1] - tip[0]) * 1e3

    np.testing.assert_allclose(end("arc:angle_deg=180,radius_mm=10,plane=yz", 6.0), [0.0, -20.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(end("line:y_mm=0,z_mm=8,laps=0.5,seconds=4", 3.0), [0.0, 0.0, 8.0], atol=1e-4)
    x, y, z = forward(PAIR.master, START)[:3, 3].tolist()
    rows = [f"{t},{x},{y + 0.002 * t},{z}" for t in range(6)]
    (tmp_path / "way.csv").write_text("\n".join(["time_s,x_m,y_m,z_m", *rows]))
    np.testing.assert_allclose(end(str(tmp_path / "way.csv"), 5.0025), [0.0, 10.0, 0.0], atol=1e-4)


def test_a_slave_parked_beside_the_object_is_refused_by_check_and_before_anything_moves() -> None:
    assert CELL.object is not None
    nearer = CELL.model_copy(update={"object": CELL.object.model_copy(update={"grasp_distance_m": 0.25})})
    (line,) = [each for each in unsound(nearer) if each.startswith("object.slave")]
    assert "at home, its hand is 50 mm from where it holds the object" in line
    with pytest.raises(TruthError, match=r"the hand of 'slave' is .* mm from where it is to hold it"):
        Rig("rhino-pair", truth={"slave_waist.initial_deg": 15})
