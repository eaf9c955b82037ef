"""URDF files: the arm that is read moves as MuJoCo's and Pinocchio's own readers have it, and what no cell can hold is
refused in one line.
"""

import os
import re
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Any

import mujoco
import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

from canarm_protocol.cell import urdf
from canarm_protocol.cell.urdf import LARGEST_BYTES, UrdfJoint, parse_urdf, read_urdf
from canarm_protocol.errors import CellError

Floats = NDArray[np.float64]

BENCH_ARM = Path(__file__).parents[2] / "examples" / "arms" / "bench_arm.urdf"
GRAVITY = np.array([0.0, 0.0, -9.81])


def rotation(axis: Floats, angle: float) -> Floats:
    """Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def mass_and_gravity(joints: tuple[UrdfJoint, ...], q: Floats) -> tuple[Floats, Floats]:
    """M(q) and g(q) of the bodies by Jacobians: M = sum of m Jv'Jv + Jw'I Jw."""
    count = len(joints)
    axes, origins = np.zeros((count, 3)), np.zeros((count, 3))
    mass, torque = np.zeros((count, count)), np.zeros(count)
    frame, origin = np.eye(3), np.zeros(3)
    for k, joint in enumerate(joints):
        roll, pitch, yaw = np.radians(joint.origin_rpy_deg)
        origin = origin + frame @ joint.origin_m
        frame = frame @ rotation(np.eye(3)[2], yaw) @ rotation(np.eye(3)[1], pitch) @ rotation(np.eye(3)[0], roll)
        axis = np.array(joint.axis)
        axes[k], origins[k] = frame @ axis, origin
        frame = frame @ rotation(axis, q[k])
        centre = origin + frame @ joint.centre_of_mass_m
        ixx, iyy, izz, ixy, ixz, iyz = joint.inertia_kg_m2
        tensor = frame @ np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]) @ frame.T
        turning = np.where(np.arange(count)[:, None] <= k, axes, 0.0)
        moving = np.cross(turning, centre - origins)
        mass += joint.mass_kg * moving @ moving.T + turning @ tensor @ turning.T
        torque -= joint.mass_kg * moving @ GRAVITY
    return mass, torque


def by_pinocchio(text: str) -> Callable[[Floats], tuple[Floats, Floats]]:
    model = pinocchio.buildModelFromXML(text)
    data = model.createData()

    def at(q: Floats) -> tuple[Floats, Floats]:
        # A joint without stops has cosine and sine as coordinates there.
        coordinates: list[float] = []
        for joint, angle in zip(model.joints[1:], q, strict=True):
            coordinates += [np.cos(angle), np.sin(angle)] if joint.nq == 2 else [angle]
        mass = pinocchio.crba(model, data, np.array(coordinates))
        full = np.triu(mass) + np.triu(mass, 1).T
        return full, pinocchio.computeGeneralizedGravity(model, data, np.array(coordinates))

    return at


def by_mujoco(text: str) -> Callable[[Floats], tuple[Floats, Floats]]:
    # It would look for the mesh.
    model = mujoco.MjModel.from_xml_string(re.sub(r"<visual>.*?</visual>", "", text, flags=re.DOTALL))
    model.opt.gravity = GRAVITY
    data = mujoco.MjData(model)

    def at(q: Floats) -> tuple[Floats, Floats]:
        data.qpos[:] = q
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        return mass, np.array(data.qfrc_bias)

    return at


@pytest.mark.parametrize("reader", [by_pinocchio, by_mujoco])
def test_the_arm_of_a_file_moves_as_the_engines_own_readers_have_it(
    reader: Callable[[str], Callable[[Floats], tuple[Floats, Floats]]],
) -> None:
    text = BENCH_ARM.read_text()
    theirs = reader(text)
    joints = parse_urdf(text, "bench_arm")
    random = np.random.default_rng(1)
    for _ in range(25):
        q = random.uniform(-2.0, 2.0, len(joints))
        mass, gravity = mass_and_gravity(joints, q)
        expected_mass, expected_gravity = theirs(q)
        np.testing.assert_allclose(mass, expected_mass, atol=1e-9)
        np.testing.assert_allclose(gravity, expected_gravity, atol=1e-8)


def test_what_is_fixed_is_joined_to_the_body_that_carries_it() -> None:
    flange = read_urdf(BENCH_ARM)[-1]
    # 0.1 kg at x = 10 mm and 0.1 kg at 40 + 20 mm.
    assert flange.mass_kg == pytest.approx(0.2)
    assert flange.centre_of_mass_m == pytest.approx((0.035, 0.0, 0.0025))


def test_names_limits_and_friction_are_those_of_the_file() -> None:
    joints = read_urdf(BENCH_ARM)
    assert [joint.name for joint in joints] == [
        "waist", "shoulder", "elbow", "forearm_roll", "wrist_pitch", "tool_roll",
    ]  # fmt: skip
    assert joints[0].is_continuous
    assert joints[0].limits_deg == (-180.0, 180.0)
    assert joints[1].limits_deg == pytest.approx((-114.5916, 114.5916), abs=1e-4)
    assert (joints[2].velocity_rad_s, joints[2].damping_nm_s, joints[2].friction_nm) == (2.0, 0.03, 0.06)


INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
LINK = f'<link name="{{}}"><inertial><mass value="1"/>{INERTIA}</inertial></link>'


def arm(*joints: str, links: str = "abc") -> str:
    return f'<robot name="r">{"".join(LINK.format(link) for link in links)}{"".join(joints)}</robot>'


def joint(name: str = "j", ends: Sequence[str] = "ab", kind: str = "revolute", inside: str = "") -> str:
    limit = '<limit effort="1" velocity="1" lower="-1" upper="1"/>' if "<limit" not in inside else ""
    parent, child = ends
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{limit}{inside}</joint>'


BOMB = '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><robot name="&b;"/>'
REFUSED = {
    "a slide": (arm(joint(kind="prismatic"), links="ab"), "joint 'j': is prismatic; a cell has revolute"),
    "a free body": (arm(joint(kind="floating"), links="ab"), "joint 'j': is floating"),
    "two ways on": (arm(joint("j"), joint("k", "ac")), "joint 'k': branches off where joint 'j' goes on"),
    "two bases": (arm(joint("j")), "an arm has one base, a link that no joint moves; here are 'a', 'c'"),
    "a loop": (arm(joint("j", "bc"), joint("k", "cb")), "link 'b': hangs in a loop"),
    "a link moved twice": (arm(joint("j"), joint("k", "cb")), "joint 'k': link 'b' is moved by joint 'j' already"),
    "no such link": (arm(joint("j", "ax"), links="a"), "joint 'j': there is no link 'x'"),
    "no mass": (
        arm(joint(), links="a").replace("</robot>", '<link name="b"/></robot>'),
        "joint 'j': carries no mass; give link 'b' an <inertial>",
    ),
    "no inertia": (
        arm(joint(), links="a").replace(
            "</robot>", '<link name="b"><inertial><mass value="1"/></inertial></link></robot>'
        ),
        "link 'b': has a mass and no <inertia>",
    ),
    "negative mass": (arm(joint(), links="ab").replace('mass value="1"', 'mass value="-1"'), "mass -1 kg"),
    "a number that is none": (
        arm(joint(), links="ab").replace('ixy="0"', 'ixy="nan"'),
        "link 'a': <inertia> ixy = 'nan'; must be a finite",
    ),
    "an axis of length 0": (arm(joint(inside='<axis xyz="0 0 0"/>'), links="ab"), "has no direction"),
    "no limits": (
        arm(joint(inside='<limit effort="1" velocity="1"/>'), links="ab"),
        "limit lower = 0, upper = 0 rad; lower must be below upper",
    ),
    "a follower": (arm(joint("j"), joint("k", "bc", inside='<mimic joint="j"/>')), "joint 'k': mimics 'j'"),
    "names that become one": (arm(joint("J 1"), joint("j_1", "bc")), "'J 1' and 'j_1' are both 'j_1' in a cell"),
    "two links of one name": (arm(joint(), links="abb"), "link 'b': stands there 2 times"),
    "two fixed joints of one name": (
        arm(joint("j"), joint("k", "bc", "fixed"), joint("k", "bd", "fixed"), links="abcd"),
        "joint 'k': stands there 2 times",
    ),
    "eight joints": (
        arm(*(joint(f"j{k}", "abcdefghi"[k : k + 2]) for k in range(8)), links="abcdefghi"),
        "8 joints move; a cell's robot has 1 to 7",
    ),
    "nothing that moves": (arm(links="a"), "0 joints move"),
    "xacro": (
        '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro name="m"/></robot>',
        "has xacro macros; write it out first",
    ),
    "an XML bomb": (BOMB, "has a document type or an entity"),
    "nested too deep": ("<robot>" * 5000, "no valid XML"),
    "no XML": ("name = 'konkuk1'", "no valid XML"),
    "a world": ('<sdf version="1.6"/>', "begins with <sdf>; a URDF file begins with <robot>"),
    "a joint without a child": (
        arm('<joint name="j" type="revolute"><parent link="a"/></joint>', links="a"),
        "no robot: ParseError in /robot[@name='r']/joint[@name='j']: Required element not set in XML: child",
    ),
    "words for numbers": (
        arm(joint(inside='<origin xyz="a b c"/>'), links="ab"),
        "joint 'j': <origin> xyz = 'a b c'; must be 3 finite numbers",
    ),
    "two numbers of three": (arm(joint(inside='<axis xyz="0 1"/>'), links="ab"), "joint 'j': <axis> xyz = '0 1'; must"),
    "a mass in words": (
        arm(joint(), links="ab").replace('mass value="1"', 'mass value="1 kg"', 1),
        "link 'a': <mass> value = '1 kg'; must be a finite number",
    ),
    "a decimal comma": (
        arm(joint(inside='<limit effort="1" velocity="1" lower="-1,5" upper="1"/>'), links="ab"),
        "joint 'j': <limit> lower = '-1,5'; must be a finite number",
    ),
    "an inertia that lacks a part": (
        arm(joint(), links="ab").replace(' iyz="0"', ""),
        "link 'a': <inertia> has no iyz; give it",
    ),
    "an escape sequence for a number": (
        arm(joint(inside='<dynamics damping="&#x9b;31m"/>'), links="ab"),
        "joint 'j': <dynamics> damping = '\\x9b31m'; must be a finite number",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_no_cell_can_hold_is_refused_in_one_line(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    text, expected = REFUSED[what]
    with pytest.raises(CellError) as caught:
        parse_urdf(text, "arm.urdf")
    assert str(caught.value).startswith("arm.urdf: ")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capsys.readouterr().err == ""


def test_only_regular_files_of_bounded_size_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo.urdf")
    (tmp_path / "large.urdf").write_bytes(b" " * (LARGEST_BYTES + 1))
    for name, expected in (
        ("fifo.urdf", "is no regular file; an arm is a URDF file"),
        ("large.urdf", f"is larger than {LARGEST_BYTES} bytes"),
        ("missing.urdf", "no such file"),
    ):
        with pytest.raises(CellError, match=expected):
            read_urdf(tmp_path / name)


def test_a_file_of_many_fixed_joints_takes_time_that_grows_with_their_number() -> None:
    def lines_run(count: int) -> int:
        links = [f"l{number}" for number in range(count + 1)]
        text = "".join(LINK.format(link) for link in links)
        for number, ends in enumerate(pairwise(links)):
            text += joint(f"j{number}", ends, "fixed" if number else "revolute")
        run = 0

        def count_lines(frame: FrameType, event: str, _: object) -> Any:
            nonlocal run
            is_ours = frame.f_code.co_filename == urdf.__file__
            run += event == "line" and is_ours
            return count_lines if is_ours else None

        sys.settrace(count_lines)
        try:
            parse_urdf(f'<robot name="r">{text}</robot>', "arm")
        finally:
            sys.settrace(None)
        return run

    short, long = lines_run(100), lines_run(200)
    assert long < 2.2 * short


def test_a_comment_may_contain_what_a_document_may_not() -> None:
    assert len(parse_urdf(f"<!-- <!ENTITY> -->{arm(joint(), links='ab')}", "arm")) == 1
