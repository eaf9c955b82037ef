"""The page on two RHINO robots: its figures are recomputed, its sentences hold, and the committed page has both."""

import importlib
import math
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from canarm_protocol.cell import load_cell

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "scripts"))
figures = importlib.import_module("rhino_figures")
energy = importlib.import_module("rhino_energy")
rhino_page = importlib.import_module("rhino_page")
rhino_pictures = importlib.import_module("rhino_pictures")
skeleton = importlib.import_module("ablation_page").skeleton

pytestmark = pytest.mark.slow
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def results() -> "figures.Results":
    return figures.compute()


def test_every_sentence_of_the_page_fits_the_figures(results: "figures.Results") -> None:
    assert rhino_page.misfits(results) == []


def test_the_committed_page_is_what_make_rhino_writes(results: "figures.Results") -> None:
    committed = (ROOT / "docs" / "rhino.md").read_text(encoding="utf-8")
    assert skeleton(committed) == skeleton(rhino_page.page(results))
    for name, text in rhino_pictures.pictures(results).items():
        picture = (ROOT / "docs" / "pictures" / name).read_text(encoding="utf-8")
        assert len(picture) == pytest.approx(len(text), rel=0.02)


def test_fig_6_has_ten_curves_over_the_lap_and_the_map_a_mark_and_a_word_for_every_colour(
    results: "figures.Results",
) -> None:
    joints, reachable = (ElementTree.fromstring(text) for text in rhino_pictures.pictures(results).values())
    assert len(joints.findall(f"{SVG}polyline")) == 10
    assert all(len(line.get("points", "").split()) == 201 for line in joints.findall(f"{SVG}polyline"))
    texts = [each.text for each in reachable.findall(f"{SVG}text")]
    colours = {(each.get("fill"), each.get("fill-opacity")) for each in reachable.findall(f"{SVG}rect")}
    legend = [each for each in reachable.findall(f"{SVG}rect") if each.get("width") == "14"]
    assert {(each.get("fill"), each.get("fill-opacity")) for each in legend} == colours
    assert {"out of reach", "singular", "1  the master's base", "3  B, 0.3 m from A"} <= set(texts)


def test_a_sentence_that_no_longer_holds_is_named(results: "figures.Results") -> None:
    wrong = replace(results, way_of_b_m=(0.2, 0.1))
    assert [each.text[:39] for each in rhino_page.misfits(wrong)] == ["A grasp nearer to the master is better."]


def test_over_a_lap_friction_takes_what_the_motors_do_and_do_not_brake(results: "figures.Results") -> None:
    """A lap ends where it began: no weight is higher, nothing is faster. Friction by the cell's own figures; the model
    rounds off the step of dry friction, and these joints are slow.
    """
    cell = load_cell("rhino-pair")
    paths = (results.lap.master_rad, results.cost.master), (results.lap.slave_rad, results.cost.slave)
    for robot, (q_rad, cost) in zip(cell.robot, paths, strict=True):
        speed = np.abs(np.gradient(q_rad, results.lap.time_s, axis=0))
        lost_w = sum(
            speed[:, i] * (joint.motor.coulomb_friction_nm + joint.motor.viscous_friction_nm_s * speed[:, i])
            for i, joint in enumerate(robot.joint)
        )
        lost_j = float(np.trapezoid(lost_w, results.lap.time_s))
        assert 0.75 * lost_j < cost.lost_j <= lost_j
        assert cost.work_j > cost.lost_j


def test_windings_are_heated_by_the_weights(results: "figures.Results") -> None:
    """At rest in the first pose, R·(weight/K_I)² by the kinematics alone: masses on the paper's frames."""
    cell = load_cell("rhino-pair")
    plan = results.lap
    still = replace(
        plan,
        master_rad=np.tile(plan.master_rad[0], (11, 1)),
        slave_rad=np.tile(plan.slave_rad[0], (11, 1)),
        time_s=np.linspace(0.0, 1.0, 11),
    )
    (slave,) = (robot for robot in cell.laden if robot.name == "slave")
    shoulder = slave.joint[1]
    heat_w = energy._energy(slave, still.time_s, still.slave_rad).heat_j
    q2, q3, q4 = plan.slave_rad[0][1:4].tolist()
    c2, c23, c234 = math.cos(q2), math.cos(q2 + q3), math.cos(q2 + q3 + q4)
    a, reach = 0.2286, 0.1683
    out = math.sin(q2 + q3 + q4)  # how far the hand's z axis points outward, against its sign
    hand_kg, point_kg = 0.35, 0.2
    moment = 2.2 * 0.1143 * c2 + 1.2 * (a * c2 + 0.1143 * c23) + 0.5 * (a * (c2 + c23) + 0.0047 * c234)
    moment += hand_kg * (a * (c2 + c23) + 0.0095 * c234 - (reach - 0.0842) * out)
    moment += point_kg * (a * (c2 + c23) + 0.0095 * c234 - reach * out)
    current_a = 9.8062 * moment / (524.0 * 0.04 * 0.6)
    assert heat_w > shoulder.motor.winding_ohm * current_a**2 > 0.6 * heat_w
