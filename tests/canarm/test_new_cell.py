"""New cells: what is written loads, its drives are strong enough, its traffic fits, and what cannot be is refused."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio
import pytest

from canarm.cli import run
from canarm.new_cell import NewCellError, Request, write_cell
from canarm.new_cell.arms import arm_of_urdf, made_up_arm
from canarm.rig.rig import Rig
from canarm_controller.errors import TrajectoryError
from canarm_controller.reference.trajectory import make_trajectory
from canarm_controller.run.state import State
from canarm_protocol.cell.arm import LEAST_MASS_KG
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.schedulability import cell_verdict
from canarm_protocol.cell.sensing import joint_sensors

INERTIA_KEYS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
ARMS = Path(__file__).parents[2] / "examples" / "arms"
BENCH_ARM = ARMS / "bench_arm.urdf"


@cache
def cell_of(joint_count: int, request: Request | None = None) -> Cell:
    return write_cell(made_up_arm(joint_count), request or Request(), Path())[1]


@cache
def urdf_cell() -> Cell:
    return write_cell(arm_of_urdf(BENCH_ARM, "bench_arm.urdf"), Request(), ARMS)[1]


def limit_nm(cell: Cell) -> np.ndarray:
    return np.array([joint.motor.torque_per_ampere * joint.drive.max_current_a for joint in cell.joints])


def by_pinocchio(cell: Cell) -> pinocchio.Model:
    """The cell's bodies, one by one, as Pinocchio has them."""
    model = pinocchio.Model()
    model.gravity.linear = np.array(cell.robot[0].gravity_m_s2)
    parent = 0
    for joint in cell.joints:
        body = joint.body
        assert body is not None
        placement = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(*np.radians(body.origin_rpy_deg)), np.array(body.origin_m))
        unaligned = pinocchio.JointModelRevoluteUnaligned(np.array(body.axis))
        parent = model.addJoint(parent, unaligned, placement, joint.name)
        xx, yy, zz, xy, xz, yz = body.inertia_kg_m2
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        inertia = pinocchio.Inertia(body.mass_kg, np.array(body.centre_of_mass_m), tensor)
        model.appendBodyToJoint(parent, inertia, pinocchio.SE3.Identity())
    return model


@pytest.mark.parametrize("joint_count", [1, 3, 5, 6, 7])
def test_no_pose_takes_more_than_sixty_percent_of_a_drive_to_hold(joint_count: int) -> None:
    cell = cell_of(joint_count)
    check_hold(cell)


def test_the_drives_of_an_arm_from_a_file_hold_it_in_any_pose() -> None:
    check_hold(urdf_cell())


def check_hold(cell: Cell) -> None:
    model = by_pinocchio(cell)
    data = model.createData()
    low, high = (np.radians([joint.limits_deg[end] for joint in cell.joints]) for end in (0, 1))
    random = np.random.default_rng(2)
    shares = [
        np.abs(pinocchio.computeGeneralizedGravity(model, data, random.uniform(low, high))) / limit_nm(cell)
        for _ in range(4000)
    ]
    assert np.max(shares) <= 0.6
    # The least strong enough that is sold: one that is weighed down, not all of them.
    assert np.max(shares) > 0.3


@pytest.mark.parametrize("limits_deg", [(30.0, 170.0), (-300.0, -200.0), (0.0, 90.0), (-5.0, 175.0)])
def test_a_joint_whose_limits_leave_out_zero_is_measured_all_the_same(limits_deg: tuple[float, float]) -> None:
    arm = made_up_arm(1)
    joint = replace(arm.joints[0], limits_deg=limits_deg, home_deg=sum(limits_deg) / 2.0)
    cell = write_cell(replace(arm, joints=[joint]), Request(), Path())[1]
    with Rig(cell) as rig:
        rig.run(1.0)
        assert rig.state is State.RUNNING, rig.reason
        assert not rig.detections
    step_rad = joint_sensors(cell)[0].position.scale.lsb
    assert rig.joints["shoulder"].measured_rad[-1] == pytest.approx(
        rig.joints["shoulder"].true_angle_rad[-1], abs=3.0 * step_rad
    )


@pytest.mark.parametrize("joint_count", [1, 5])
def test_encoders_instead_of_potentiometers_are_counted_by_a_card_of_their_own(joint_count: int) -> None:
    cell = cell_of(joint_count, Request(sensing=("encoder", "tachometer")))
    counters = [card for card in cell.card if card.model == "encoder_counter"]
    assert [len(card.channel) for card in counters] == ([1] if joint_count == 1 else [4, 1])
    assert all(card.node_id == 0x10 + card.slot for card in cell.card)
    assert len({card.slot for card in cell.card}) == len(cell.card)
    with Rig(cell) as rig:
        rig.run(1.0)
        assert rig.state is State.RUNNING, rig.reason
        assert not rig.detections


@pytest.mark.parametrize("joint_count", range(1, 8))
def test_every_signal_is_wired_once_and_the_bus_carries_it(joint_count: int) -> None:
    cell = cell_of(joint_count)
    signals = [channel.signal for card in cell.card for channel in card.channel]
    assert len(signals) == len(set(signals)) == 5 * joint_count
    assert all(card.node_id == 0x10 + card.slot for card in cell.card)
    assert cell_verdict(cell).fits


def test_what_is_written_is_what_is_loaded_again(tmp_path: Path) -> None:
    text, cell = write_cell(made_up_arm(3), Request(), Path())
    (tmp_path / "my.toml").write_text(text)
    assert load_cell(str(tmp_path / "my.toml")) == cell
    assert text.count("assumed") > 50


@pytest.mark.slow
def test_a_file_is_found_from_where_the_cell_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arms").mkdir()
    (tmp_path / "cells").mkdir()
    (tmp_path / "arms" / "mine.urdf").write_text(BENCH_ARM.read_text())
    monkeypatch.chdir(tmp_path / "arms")
    assert run(["new-cell", "--urdf", "mine.urdf", "--out", "../cells/mine.toml"]) == 0
    monkeypatch.chdir(tmp_path)
    cell = load_cell("cells/mine.toml")
    assert cell.joint_names[0] == "waist"
    assert all(joint.body is not None for joint in cell.joints)


def test_seven_joints_at_a_thousandth_of_a_second_are_refused_with_the_arithmetic() -> None:
    with pytest.raises(NewCellError) as caught:
        cell_of(7, Request(cycle_us=1000))
    # 21 inputs in six frames of 135 or 115 bits, seven outputs in two, two latches, SYNC: 1195 bits by hand.
    assert "= 1195 bits" in str(caught.value)
    assert "load with all that is cyclic: 122.1 %" in str(caught.value)


@pytest.mark.parametrize(("joints", "bits", "cycle_us"), [(7, 8, 1000), (3, 16, 1000), (3, 16, 1850), (2, 12, 700)])
def test_the_advised_cycle_is_the_shortest_in_tenths_of_a_millisecond(joints: int, bits: int, cycle_us: int) -> None:
    def refusal(cycle_us: int) -> str:
        with pytest.raises(NewCellError) as caught:
            cell_of(joints, Request(bits=bits, cycle_us=cycle_us))
        return str(caught.value)

    advised = int(refusal(cycle_us).rsplit("--cycle-us ", 1)[1].removesuffix(" fits"))
    assert cell_of(joints, Request(bits=bits, cycle_us=advised)).bus.cycle_us == advised
    assert advised - 100 <= cycle_us or f"--cycle-us {advised} fits" in refusal(advised - 100)


def test_a_slower_bus_gets_a_longer_cycle() -> None:
    assert cell_of(2).bus.cycle_us == 2500
    assert cell_of(2, Request(bitrate=125_000)).bus.cycle_us > 2500


@pytest.mark.parametrize("words", [[], pytest.param(["--force"], marks=pytest.mark.slow)])
def test_a_full_disk_leaves_no_half_of_a_cell(
    words: list[str], tmp_path: Path, full_at, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "my.toml"
    if words:
        out.write_text("precious")
    with full_at(1000):
        assert run(["new-cell", "--joints", "1", "--out", str(out), *words]) == 2
    assert f"--out {out}: cannot be written: File too large" in capsys.readouterr().err
    assert [path.read_text() for path in tmp_path.iterdir()] == (["precious"] if words else [])


def test_encoders_are_asked_for_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "my.toml"
    assert run(["new-cell", "--joints", "1", "--position-sensor", "encoder", "--out", str(out)]) == 0
    assert "card counter: encoder_counter in slot 4, node 0x14, 1 wires" in capsys.readouterr().out
    sensors = load_cell(str(out)).joints[0].sensors
    assert sensors.encoder is not None
    assert sensors.potentiometer is None


def test_a_link_that_somebody_has_planted_is_not_followed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "my.toml"
    out.symlink_to(tmp_path / "precious.toml")
    assert run(["new-cell", "--joints", "1", "--out", str(out)]) == 2
    assert "my.toml: is a symbolic link; take another name, or --force" in capsys.readouterr().err
    assert not (tmp_path / "precious.toml").exists()


def test_help_shows_defaults_as_they_are_written(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["new-cell", "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "[default: potentiometer tachometer current_sense]" in shown


@pytest.mark.parametrize("mass_kg", ["1e-300", "1e-13", pytest.param("1e-5", marks=pytest.mark.slow), "1e-4"])
def test_an_arm_without_weight_worth_the_name_is_no_ready_cell(
    mass_kg: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Either it is refused in a line that names the joint, or what was written passes the check.
    inertia = " ".join(f'{key}="{float(mass_kg) * 1e-2 if key[1] == key[2] else 0:g}"' for key in INERTIA_KEYS)
    inertial = f'<inertial><mass value="{mass_kg}"/><inertia {inertia}/></inertial>'
    joint = (
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
        '<limit effort="1" velocity="1" lower="-1" upper="1"/></joint>'
    )
    urdf, out = tmp_path / "arm.urdf", tmp_path / "my.toml"
    urdf.write_text(f'<robot name="r"><link name="a"/><link name="b">{inertial}</link>{joint}</robot>')
    status = run(["new-cell", "--urdf", str(urdf), "--out", str(out)])
    complaint = capsys.readouterr().err
    if status == 0:
        assert run(["check", "--cell", str(out)]) == 0
        assert float(mass_kg) >= LEAST_MASS_KG
        return
    assert status == 2
    assert complaint.count("\n") == 1
    assert "joint 'j'.body.mass_kg = " in complaint
    assert "must be at least 1e-06" in complaint
    assert not out.exists()


def test_what_does_not_run_is_not_called_ready(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # An amplifier that is sized for a fifth of the weight: no file says so, the rehearsal does.
    monkeypatch.setattr("canarm.new_cell.sizing.HOLD_SHARE", 5.0)
    monkeypatch.setattr("canarm.new_cell.sizing.MOTION_SHARE", 5.0)
    monkeypatch.setattr("canarm.new_cell.sizing.LEAST_RAD_S2", 0.1)
    out = tmp_path / "my.toml"
    assert run(["new-cell", "--joints", "1", "--out", str(out)]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert "joint 'shoulder'.drive.max_current_a = " in said.err
    assert "ready" not in said.out
    assert not out.exists()


def test_a_file_that_is_there_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "my.toml"
    out.write_text("mine")
    assert run(["new-cell", "--joints", "1", "--out", str(out)]) == 2
    assert out.read_text() == "mine"
    assert "is there already" in capsys.readouterr().err
    assert run(["new-cell", "--joints", "1", "--out", str(out), "--force"]) == 0
    assert load_cell(str(out)).joint_names == ("shoulder",)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "of which arm?"),
        (["--joints", "7", "--position-sensor", "encoder"], "2 counter, 2 ADC; a robot has 7 slots; take fewer"),
        (["--joints", "7", "--cycle-us", "1000"], "--cycle-us 1000 does not fit: 1000000 bit/s x 1000 us = 1000 bits"),
        (["--joints", "3", "--urdf", "arm.urdf"], "of which arm?"),
        (["--joints", "8"], "--joints 8: must be 1 to 7"),
        (["--urdf", "missing.urdf"], "--urdf missing.urdf: there is no such file"),
        (["--joints", "2", "--bitrate", "9600"], "canarm: --bitrate 9600: must be one of 10000"),
        (["--joints", "2", "--bits", "20"], "--bits 20: must be 8 to 16"),
    ],
)
def test_what_cannot_be_written_is_refused(
    words: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["new-cell", *words, "--out", str(tmp_path / "my.toml")]) == 2
    complaint = capsys.readouterr().err
    assert expected in complaint
    assert complaint.count("\n") == 1
    assert not (tmp_path / "my.toml").exists()


def test_limits_of_a_urdf_file_are_used_or_said_not_to_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "my.toml"
    arm = tmp_path / "arm.urdf"
    text = BENCH_ARM.read_text(encoding="utf-8")
    arm.write_text(text.replace('effort="3" velocity="2.5"', 'effort="0" velocity="0"'), encoding="utf-8")
    assert run(["new-cell", "--urdf", str(arm), "--out", str(out), "--sensors", "potentiometer"]) == 0
    said = capsys.readouterr().out
    # <limit effort=... velocity=...> of bench_arm.urdf; 0 is what exporters write where nothing is known
    assert "in N m, not used: waist 20, shoulder 30, elbow 15, forearm_roll 6, wrist_pitch 5\n" in said
    assert "joint waist: its drive has 29 N m, more than the effort limit of 20 N m" in said
    assert out.read_text(encoding="utf-8").count("not used: ") == 5
    cell = load_cell(str(out))
    assert [joint.max_speed_rad_s for joint in cell.joints] == [2.0, 2.0, 2.0, 2.5, 2.5, None]
    names = list(cell.joint_names)
    # A swing of the elbow by 36 degrees: 0.628 rad x 4.71 rad/s = 2.96 rad/s at most.
    still = {name: [joint.home_deg] * 401 for name, joint in zip(names, cell.joints, strict=True)}
    time_s = np.linspace(0.0, 4.0, 401)
    still["elbow"] = [36.0 * np.sin(1.5 * np.pi * each) for each in time_s]
    with pytest.raises(
        TrajectoryError, match=r"elbow .* rad/s is beyond max_speed_rad_s of the cell; must be .*2 rad/s"
    ):
        make_trajectory({"time_s": time_s, **still}, cell)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--cycle-us", "0"], "--cycle-us 0: must be 500 to 100000 us; --cycle-us 1500 fits"),
        (["--cycle-us", "-5"], "--cycle-us -5: must be 500 to 100000 us; --cycle-us 1500 fits"),
        (["--cycle-us", "1000000"], "--cycle-us 1000000: must be 500 to 100000 us"),
        (["--bits", "7"], "--bits 7: must be 8 to 16"),
        (["--urdf", "a"], "--urdf a and --joints 2: of which arm? take one of the two"),
    ],
    ids=lambda each: " ".join(each) if isinstance(each, list) else "",
)
def test_a_limit_is_said_by_the_name_of_its_option(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """8 to 16 bits are those of the cards; the bit rates are those of CiA 301."""
    assert run(["new-cell", "--joints", "2", *words, "--out", str(tmp_path / "my.toml")]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert "arm2:" not in told, "no key of a file that is not there"
    assert not (tmp_path / "my.toml").exists()


def test_of_a_cycle_that_is_too_long_for_the_arm_one_is_named_that_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["new-cell", "--joints", "2", "--out", str(tmp_path / "my.toml")]
    assert run([*words, "--cycle-us", "50000"]) == 2
    found = re.fullmatch(r".*too long for this arm: .*; --cycle-us (\d+) works\n", capsys.readouterr().err)
    assert found is not None
    assert run([*words, "--cycle-us", found[1]]) == 0


def test_an_inertia_that_no_body_has_is_said_in_the_files_own_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Products of inertia without moments: in a turned frame they would show as a negative moment."""
    text = re.sub('i(xx|yy|zz)="[^"]*"', r'i\1="0"', BENCH_ARM.read_text())
    (tmp_path / "arm.urdf").write_text(text)
    assert run(["new-cell", "--urdf", str(tmp_path / "arm.urdf"), "--out", str(tmp_path / "my.toml")]) == 2
    told = capsys.readouterr().err
    assert 'arm.urdf: link \'column\': inertia ixx="0" iyy="0" izz="0" ixy=' in told
    assert "no body has it" in told
