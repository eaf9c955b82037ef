"""The picture of the arm: joints by Pinocchio and by trigonometry; what is where on the screen."""

import math

import numpy as np
import pinocchio
import pytest

from canarm_protocol.cell.arm import Body
from canarm_protocol.cell.cell_file import load_cell
from canarm_tui.arm_drawing import Layer, Pose, drawing, projections
from canarm_tui.kinematics import joint_places

NOTHING = np.full((0, 2), np.nan)


def test_two_links_of_18_cm_reach_where_trigonometry_says(cell):
    first, second = math.radians(20.0), math.radians(-50.0)
    (places,) = joint_places(cell, np.array([[first, second]]))
    elbow = [0.18 * math.cos(first), 0.18 * math.sin(first), 0.0]
    tip = [elbow[0] + 0.18 * math.cos(first + second), elbow[1] + 0.18 * math.sin(first + second), 0.0]
    np.testing.assert_allclose(places[0], [[0.0, 0.0, 0.0], elbow, tip], atol=1e-12)


def test_an_arm_in_a_vertical_plane_is_seen_from_the_side_and_up_is_up(cell):
    views = projections(cell)
    assert [view.name for view in views] == ["side view x–y"]
    np.testing.assert_array_equal(views[0].flat(np.array([0.1, 0.2, 0.3])), [0.1, 0.2])


def test_two_arms_are_seen_from_two_sides_and_from_above_with_the_object_between_them():
    pair = load_cell("rhino-pair")
    views = projections(pair)
    assert len(views) == 3
    assert views[-1].name.startswith("top view")
    home = np.radians([joint.home_deg for joint in pair.joints])
    _, layers = drawing(pair, views[0], Pose(home, home, np.full((0, len(home)), np.nan)), 20, 40)
    assert {Layer.TRUE, Layer.OBJECT} <= set(layers.ravel().tolist())


def test_the_true_arm_is_drawn_over_the_reference_and_the_trail_where_the_tip_was(cell):
    view = projections(cell)[0]
    up, right = np.radians([90.0, 0.0]), np.array([0.0, 0.0])
    bits, layers = drawing(cell, view, Pose(right, up, np.array([np.radians([-90.0, 0.0])])), 21, 40)
    middle = int(np.argmax((layers == Layer.TRUE).sum(axis=1)))
    assert set(layers[middle, -2:].tolist()) <= {Layer.TRUE, -1}
    assert Layer.TRUE in layers[middle, 25:]
    assert Layer.REFERENCE in layers[:middle, :]
    assert Layer.TRAIL in layers[middle:, :]
    assert Layer.REFERENCE not in layers[middle + 2 :, :]
    same, _ = drawing(cell, view, Pose(right, right, NOTHING), 21, 40)
    assert np.count_nonzero(same) < np.count_nonzero(bits)


@pytest.mark.parametrize(("rows", "cells"), [(1, 1), (1, 80), (40, 2)])
def test_any_room_is_borne_and_an_unknown_pose_is_not_drawn(cell, rows, cells):
    view, nowhere = projections(cell)[0], np.array([np.nan, 0.0])
    assert drawing(cell, view, Pose(nowhere, nowhere, NOTHING), rows, cells)[0].max() == 0
    far = np.array([1e30, -1e30])
    assert drawing(cell, view, Pose(far, far, NOTHING), rows, cells)[0].shape == (rows, cells)


def test_joints_of_bodies_are_where_pinocchio_has_them():
    """A chain of five bodies with axes and turns of their own, on a base that stands askew."""
    cell = load_cell("rhino-pair")
    random = np.random.default_rng(5)
    joints, model, base = [], pinocchio.Model(), (0.1, -0.2, 0.3)
    parent = 0
    frame = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(*np.radians((20.0, -35.0, 70.0))), np.array(base))
    for number, joint in enumerate(cell.robot[0].joint):
        axis = random.normal(size=3)
        body = Body(
            origin_m=tuple(random.uniform(-0.3, 0.3, 3)),
            origin_rpy_deg=tuple(random.uniform(-180.0, 180.0, 3)),
            axis=tuple(axis / np.linalg.norm(axis)),
            mass_kg=1.0,
            centre_of_mass_m=(0.1, 0.0, 0.05),
            inertia_kg_m2=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0),
        )
        joints.append(joint.model_copy(update={"link": None, "body": body}))
        turn = pinocchio.rpy.rpyToMatrix(*np.radians(body.origin_rpy_deg))
        place = frame * pinocchio.SE3(turn, np.array(body.origin_m))
        revolute = pinocchio.JointModelRevoluteUnaligned(np.array(body.axis))
        parent, frame = model.addJoint(parent, revolute, place, str(number)), pinocchio.SE3.Identity()
    robot = cell.robot[0].model_copy(
        update={"joint": tuple(joints), "base_m": base, "base_rpy_deg": (20.0, -35.0, 70.0)}
    )
    alone = cell.model_copy(update={"robot": (robot,)})
    angles = random.uniform(-3.0, 3.0, (4, len(joints)))
    (found,) = joint_places(alone, angles)
    for places, pose in zip(found, angles, strict=True):
        data = model.createData()
        pinocchio.forwardKinematics(model, data, pose)
        expected = [np.array(base), *(data.oMi[each].translation for each in range(1, len(joints) + 1))]
        np.testing.assert_allclose(places[:-1], expected, atol=1e-12)
        np.testing.assert_allclose(places[-1], data.oMi[len(joints)].act(np.array([0.2, 0.0, 0.1])), atol=1e-12)
