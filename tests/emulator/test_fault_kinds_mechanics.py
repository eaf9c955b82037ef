"""Faults of arm and drive wire, each at its tap with the parameters that a user gives."""

import math
from dataclasses import dataclass, replace
from random import Random

import pytest

from canarm_emulator.faults.catalogue import make_fault
from canarm_emulator.faults.declaration import Context, Family, Fault, TapKind, declared_faults
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.faults.points import TruthPoint
from canarm_emulator.faults.taps import taps_of
from canarm_emulator.robot.truth import JointTruth, Truth
from canarm_emulator.robot.world import JointState, World
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.script import FaultSpec

CELL = load_cell("konkuk1")
TAPS = taps_of(CELL)
CYCLE_NS = CELL.bus.cycle_ns
MECHANICS = [
    (name, tap.name)
    for (name, kind), fault in declared_faults().items()
    if fault.family is Family.MECHANICS
    for tap in TAPS.values()
    if tap.kind is kind
]
RIGID: dict[str, str] = {}
ELASTIC = {"joint2.wire": "1", "joint3.wire": "1"}


@dataclass
class Rigged:
    """A bench whose arm moves, held up by constant currents, with the one point where truths are changed."""

    bench: FaultBench
    point: TruthPoint

    @property
    def world(self) -> World:
        return self.bench.world

    @property
    def joints(self) -> list[JointState]:
        return self.world.state()

    def run(self, seconds: float) -> None:
        self.world.advance(self.world.time_ns + round(seconds * 1e9))

    def begin(self, tap: str, name: str, **parameters: float) -> Fault:
        fault = make_fault(TAPS, FaultSpec(tap, name, parameters))
        self.point.add(fault, Context(TAPS[tap], self.world.time_ns, CYCLE_NS, Random(0)))
        return fault

    def end(self, fault: Fault) -> None:
        self.point.remove(fault, self.world.time_ns)


def rigged(settings: dict[str, str] = RIGID, currents_a: tuple[float, float] = (0.6, 0.2)) -> Rigged:
    bench = FaultBench(CELL, Truth.from_settings(CELL, settings), Clock.SYNC, 0)
    for joint, current_a in enumerate(currents_a):
        bench.world.set_dac_output(joint, abs(current_a) / 1.5 * 255 / 256)
        bench.world.set_direction(joint, DirectionBits.COUNTER_CLOCKWISE if current_a > 0 else DirectionBits.CLOCKWISE)
    bench.world.advance(20_000_000)
    return Rigged(bench, TruthPoint(bench))


def faulty(tap: str, name: str, joint: JointTruth | None = None, **parameters: float) -> JointTruth:
    fault = make_fault(TAPS, FaultSpec(tap, name, parameters))
    return fault.change(joint or Truth.from_settings(CELL).joints[TAPS[tap].joint], 0)  # type: ignore[attr-defined]


def test_every_fault_of_the_arm_is_found_at_every_link_or_every_wire() -> None:
    links = {name for name, tap in MECHANICS if tap == "joint3.link"}
    wires = {name for name, tap in MECHANICS if tap == "joint3.wire"}
    assert links == {"payload-change", "friction-change", "joint-jam", "collision"}
    assert wires == {"wire-slack", "wire-soft", "wire-broken", "backlash"}
    assert len(MECHANICS) == 2 * len(links | wires)


@pytest.mark.parametrize("settings", [RIGID, ELASTIC], ids=["rigid", "elastic"])
@pytest.mark.parametrize(("name", "tap"), MECHANICS)
def test_each_changes_the_motion_and_is_gone_at_its_end(name: str, tap: str, settings: dict[str, str]) -> None:
    sound, arm = rigged(settings), rigged(settings)
    truth = arm.world.truth
    fault = arm.begin(tap, name)
    for each in (sound, arm):
        each.world.set_direction(1, DirectionBits.CLOCKWISE)  # what is loose shows when the torque turns round
        each.run(0.2)
    moved_deg = max(
        abs(math.degrees(one - other))
        for joint, twin in zip(arm.joints, sound.joints, strict=True)
        for one, other in ((joint.angle_rad, twin.angle_rad), (joint.motor_angle_rad, twin.motor_angle_rad))
    )
    assert moved_deg > 0.2
    arm.end(fault)
    assert arm.world.truth == truth
    arm.run(0.5)
    for joint, stiffness_nm_rad in zip(arm.joints, (200.0, 80.0), strict=True):
        twist_rad = abs(joint.motor_angle_rad - joint.angle_rad)
        if settings is RIGID:
            assert (joint.motor_angle_rad, joint.motor_speed_rad_s) == (joint.angle_rad, joint.speed_rad_s)
        else:
            assert twist_rad * stiffness_nm_rad < 12.0  # N·m: no more than a fall and a stop put on a sound wire


@pytest.mark.parametrize("settings", [RIGID, ELASTIC], ids=["rigid", "elastic"])
@pytest.mark.parametrize(("name", "tap"), MECHANICS)
def test_none_makes_the_integration_diverge_at_the_ends_of_its_parameters(
    name: str, tap: str, settings: dict[str, str]
) -> None:
    fault_type = declared_faults()[name, TAPS[tap].kind]
    metas = [each.metadata["parameter"] for each in fault_type.__dataclass_fields__.values()]  # type: ignore[attr-defined]
    for end in ("minimum", "maximum"):
        arm = rigged(settings, (1.5, -1.5))
        values = {
            field: getattr(meta, end)
            for field, meta in zip(fault_type.__dataclass_fields__, metas, strict=True)  # type: ignore[attr-defined]
        }
        fault = arm.begin(tap, name, **values)
        arm.run(0.6)
        arm.end(fault)
        arm.run(0.3)
        assert all(abs(joint.speed_rad_s) < 200.0 for joint in arm.joints)


def test_a_payload_hangs_at_the_end_of_its_link_on_top_of_another() -> None:
    one = faulty("joint3.link", "payload-change", mass=0.4)
    both = faulty("joint3.link", "payload-change", one, mass=0.3)
    assert (one.payload_kg, both.payload_kg) == (0.4, pytest.approx(0.7))
    assert both.mass_kg == 0.6


def test_with_0_3_kg_at_the_tip_a_horizontal_arm_takes_0_87_a_and_0_39_a_to_hold() -> None:
    # g·0.36 m·0.3 kg over 4.08 N·m/A and g·0.18 m·0.3 kg over 2.72 N·m/A on top of 0.606 A and 0.195 A.
    holding_a = (0.606 + 9.8062 * 0.36 * 0.3 / 4.08, 0.195 + 9.8062 * 0.18 * 0.3 / 2.72)
    still = {"joint2.initial_deg": "0"} | {
        f"{joint}.{leaf}": "0" for joint in CELL.joint_names for leaf in ("viscous", "coulomb")
    }
    moved = []
    for factor in (0.97, 1.03):
        bench = FaultBench(CELL, Truth.from_settings(CELL, still), Clock.SYNC, 0)
        arm = Rigged(bench, TruthPoint(bench))
        arm.begin("joint3.link", "payload-change", mass=0.3)
        for joint, current_a in enumerate(holding_a):
            arm.world.set_dac_output(joint, factor * current_a / 1.5 * 255 / 256)
            arm.world.set_direction(joint, DirectionBits.COUNTER_CLOCKWISE)
        arm.run(0.3)
        moved.append([joint.angle_rad for joint in arm.joints])
    assert moved[0][0] < -1e-3 < 1e-3 < moved[1][0]


def test_friction_is_multiplied() -> None:
    joint = faulty("joint2.link", "friction-change", viscous=4.0, coulomb=2.0)
    assert joint.viscous_friction_nm_s == pytest.approx(0.2)
    assert joint.coulomb_friction_nm == pytest.approx(0.3)


def test_a_jam_holds_the_joint_and_lets_it_go() -> None:
    arm = rigged(currents_a=(0.6, 1.5))
    fault = arm.begin("joint3.link", "joint-jam")
    at_rad = arm.joints[1].angle_rad
    arm.run(1.0)
    assert arm.joints[1].angle_rad == pytest.approx(at_rad, abs=2e-3)
    assert arm.joints[1].speed_rad_s == pytest.approx(0.0, abs=1e-4)
    arm.end(fault)
    arm.run(0.1)
    assert arm.joints[1].angle_rad > at_rad + 0.05


@pytest.mark.parametrize("impulse", [0.03, -0.03])
def test_a_collision_happens_once_and_to_the_side_of_its_sign(impulse: float) -> None:
    arm = rigged()
    before = [joint.speed_rad_s for joint in arm.joints]
    fault = arm.begin("joint3.link", "collision", impulse=impulse)
    after = [joint.speed_rad_s for joint in arm.joints]
    # The closed forms of D and the rotors at the arm's pose; joint 2 recoils.
    cosine = math.cos(arm.joints[1].angle_rad)
    d22 = 0.18**2 * (1 / 3 + 0.6 * 4 / 3 + 0.6 * cosine) + 0.054
    d23 = 0.18**2 * 0.6 * (1 / 3 + cosine / 2)
    d33 = 0.18**2 * 0.6 / 3 + 0.024
    determinant = d22 * d33 - d23**2
    jump = [new - old for new, old in zip(after, before, strict=True)]
    assert jump == pytest.approx([-d23 * impulse / determinant, d22 * impulse / determinant], rel=1e-6)
    truth = arm.world.truth
    arm.end(fault)
    assert [joint.speed_rad_s for joint in arm.joints] == after
    assert arm.world.truth == truth == Truth.from_settings(CELL)


def test_looseness_adds_up_and_play_counts_from_flank_to_flank() -> None:
    slack = faulty("joint2.wire", "wire-slack", dead_band=3.0)
    both = faulty("joint2.wire", "backlash", slack, play=2.0)
    assert slack.has_elastic_wire
    assert math.degrees(slack.wire_dead_band_rad) == pytest.approx(3.0)
    assert math.degrees(both.wire_dead_band_rad) == pytest.approx(4.0)


@pytest.mark.parametrize(("name", "parameters"), [("wire-slack", {"dead_band": 1.5}), ("backlash", {"play": 3.0})])
def test_motor_and_link_part_by_the_looseness_and_the_stretch(name: str, parameters: dict[str, float]) -> None:
    arm = rigged({"joint2.initial_deg": "-90", "joint3.initial_deg": "0"}, (0.0, 0.15))
    arm.begin("joint3.wire", name, **parameters)
    arm.run(4.0)  # 0.41 N·m of the motor lift the hanging link to where gravity, 0.53 N·m at most, takes as much
    joint = arm.joints[1]
    assert abs(joint.motor_speed_rad_s) < 1e-2
    gravity_nm = 9.8062 * 0.09 * 0.6 * math.cos(arm.joints[0].angle_rad + joint.angle_rad)
    twist_deg = math.degrees(joint.motor_angle_rad - joint.angle_rad)
    assert twist_deg == pytest.approx(1.5 + math.degrees(gravity_nm / 80), abs=0.02)


def test_a_soft_wire_stretches_by_the_reciprocal_of_its_factor() -> None:
    twist_rad = []
    for factor in (1.0, 0.25):
        arm = rigged({"joint2.initial_deg": "-90", "joint3.initial_deg": "0"}, (0.0, 1.5))
        arm.begin("joint3.wire", "wire-soft", stiffness=factor)
        arm.begin("joint3.link", "joint-jam")
        arm.run(3.0)
        twist_rad.append(arm.joints[1].motor_angle_rad - arm.joints[1].angle_rad)
    assert twist_rad[0] == pytest.approx(1.5 * 2.72 / 80, abs=0.06 / 80)  # its friction holds back or holds on
    assert twist_rad[1] == pytest.approx(1.5 * 2.72 / 20, abs=0.06 / 20)


@pytest.mark.parametrize("settings", [RIGID, ELASTIC], ids=["rigid", "elastic"])
def test_on_a_broken_wire_the_motor_runs_away_while_the_link_falls(settings: dict[str, str]) -> None:
    arm = rigged(settings)
    fault = arm.begin("joint2.wire", "wire-broken")
    arm.run(1.0)
    joint = arm.joints[0]
    assert joint.motor_speed_rad_s > 2.4  # 0.6 A are 2.45 N·m on 0.054 kg·m², up to the no-load speed
    assert joint.angle_rad < 0.0
    arm.end(fault)
    arm.run(0.5)
    assert arm.joints[0].motor_angle_rad == pytest.approx(arm.joints[0].angle_rad, abs=0.05)
    assert declared_faults()["wire-broken", TapKind.DRIVE_WIRE].is_dangerous


def test_faults_of_one_joint_add_up_and_end_in_any_order() -> None:
    arm = rigged()
    sound = arm.world.truth
    broken = arm.begin("joint2.wire", "wire-broken")
    payload = arm.begin("joint2.link", "payload-change", mass=0.5)
    jam = arm.begin("joint3.link", "joint-jam")
    arm.run(0.1)
    arm.end(broken)
    joint2, joint3 = sound.joints
    assert arm.world.truth.joints == (replace(joint2, payload_kg=0.5), replace(joint3, is_jammed=True))
    arm.end(payload)
    arm.end(jam)
    assert arm.world.truth == sound


@pytest.mark.parametrize(
    ("name", "tap", "parameter", "value"),
    [
        ("payload-change", "joint3.link", "mass", -0.1),
        ("collision", "joint3.link", "impulse", 5.0),
        ("wire-soft", "joint3.wire", "stiffness", 0.0),
        ("wire-slack", "joint3.wire", "dead_band", 90.0),
    ],
)
def test_what_the_integration_cannot_do_is_refused(name: str, tap: str, parameter: str, value: float) -> None:
    with pytest.raises(FaultError, match=rf"{name} at {tap}: {parameter} = .*: must be a number from"):
        make_fault(TAPS, FaultSpec(tap, name, {parameter: value}))
