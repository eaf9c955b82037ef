"""Inverse dynamics against Pinocchio and, where it is installed, the Robotics Toolbox.

Candidates alternate block by block, so that other load on the machine affects all alike. Links alone, without
drives: that is what the others compute. On few cores set OMP_WAIT_POLICY=passive, or Pinocchio's threads spin.
"""

import statistics
import time
from collections.abc import Callable, Mapping

import numpy as np
import pinocchio
from measure import Ratio, Row

from canarm_controller.dynamics import chain_of
from canarm_controller.dynamics.batch import BatchProgram
from canarm_controller.dynamics.newton_euler import torque_program
from canarm_controller.dynamics.scalar import compile_scalar
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Robot

try:
    import roboticstoolbox
except ImportError:
    roboticstoolbox = None

ONE, TABLE = "one state", "table"
PINOCCHIO, LOOP, THREADS = "Pinocchio rnea", "Pinocchio rnea in a loop", "Pinocchio rneaInParallel, 2 threads"
TOOLBOX, TOOLBOX_TABLE = "Robotics Toolbox rne (C)", "Robotics Toolbox rne of a table"
BLOCKS = 31
SAMPLES = 4096
CALLS = 200
"""Evaluations of one state per measurement, so that it is long enough for the clock."""


def rows() -> list[Row]:
    """Ratios for one state and for a table of 4096, for two planar joints and for five in space."""
    if roboticstoolbox is None:
        print("dynamics: without its rows against the Robotics Toolbox; for them: pip install roboticstoolbox-python")
    konkuk = load_cell("konkuk1").robot[0]
    return [
        *_rows("2 joints", konkuk, {PINOCCHIO: "<= 2", LOOP: "<= 0.1", THREADS: "<= 0.5"}),
        *_rows("5 joints", rhino_like(konkuk), {TOOLBOX: "<= 2", TOOLBOX_TABLE: "<= 0.77"}),
    ]


def _rows(name: str, robot: Robot, goals: Mapping[str, str]) -> list[Row]:
    spent = measure(candidates(robot))
    found = []
    for ours, rivals in ((ONE, (PINOCCHIO, TOOLBOX)), (TABLE, (LOOP, THREADS, TOOLBOX_TABLE))):
        remark = f"{statistics.median(spent[ours]) * 1e6:.3f} us a state"
        for rival in rivals:
            if rival in spent:
                ratio = Ratio.of(spent[ours], spent[rival])
                found.append(Row(f"inverse dynamics, {name}, {ours}", rival, ratio, goals.get(rival, ""), remark))
    return found


def measure(functions: Mapping[str, tuple[Callable[[], object], int]]) -> dict[str, list[float]]:
    """Seconds per evaluation, block by block; each function comes with the number of evaluations per call."""
    spent: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(BLOCKS):
        for name, (function, evaluations) in functions.items():
            function()  # refills the caches, which the others have evicted
            started = time.perf_counter()
            function()
            spent[name].append((time.perf_counter() - started) / evaluations)
    return spent


def candidates(robot: Robot) -> dict[str, tuple[Callable[[], object], int]]:
    """The functions to time, by name, after a check that all compute the same."""
    chain = chain_of(robot)
    joints = len(chain.links)
    single = compile_scalar(torque_program(chain), chain.joint_names)
    batch = BatchProgram(torque_program(chain, for_batch=True), chain.joint_names)
    model = pinocchio_model(robot)
    data, pool = model.createData(), pinocchio.ModelPool(model, 2)
    states = np.random.default_rng(0).normal(size=(3, joints, SAMPLES))
    columns = [np.asfortranarray(part) for part in states]
    rows = [np.ascontiguousarray(part.T) for part in states]
    result = np.zeros((joints, SAMPLES), order="F")
    out = np.empty((joints, SAMPLES))
    first = [part[0] for part in rows]
    floats = [part.tolist() for part in first]
    expected = np.array([pinocchio.rnea(model, data, *state) for state in zip(*rows, strict=True)])
    np.testing.assert_allclose(batch(*states).T, expected, rtol=0, atol=1e-9)

    def pinocchio_loop() -> None:
        for q, qd, qdd in zip(*rows, strict=True):
            pinocchio.rnea(model, data, q, qd, qdd)

    found: dict[str, tuple[Callable[[], object], int]] = {
        ONE: (lambda: [single(*floats) for _ in range(CALLS)], CALLS),
        PINOCCHIO: (lambda: [pinocchio.rnea(model, data, *first) for _ in range(CALLS)], CALLS),
        TABLE: (lambda: batch(*states, out=out), SAMPLES),
        LOOP: (pinocchio_loop, SAMPLES),
        THREADS: (lambda: pinocchio.rneaInParallel(2, pool, *columns, result), SAMPLES),
    }
    if roboticstoolbox is not None:
        toolbox = toolbox_model(robot)
        np.testing.assert_allclose(toolbox.rne(*(part[:9] for part in rows)), expected[:9], rtol=0, atol=1e-9)
        found[TOOLBOX] = (lambda: [toolbox.rne(*first) for _ in range(CALLS)], CALLS)
        found[TOOLBOX_TABLE] = (lambda: toolbox.rne(*rows), SAMPLES)
    return found


def rhino_like(template: Robot) -> Robot:
    """Five axes with the RHINO's geometry and centres of mass on the links' own axes."""
    a, d = (0.0, 0.2286, 0.2286, 0.0095, 0.0), (0.2604, 0.0, 0.0, 0.0, 0.1683)
    alpha, mass = (-90.0, 0.0, 0.0, -90.0, 0.0), (3.0, 2.2, 1.2, 0.5, 0.35)
    joints = []
    for i in range(5):
        link = {"a_m": a[i], "d_m": d[i], "alpha_deg": alpha[i], "mass_kg": mass[i]}
        link |= {"centre_of_mass_m": (-a[i] / 2, 0.0, -0.08 if i == 4 else 0.0), "inertia_kg_m2": (0.001, 0.002, 0.002)}
        joint = template.joint[0]
        joints.append(joint.model_copy(update={"name": f"axis{i + 1}", "link": joint.dh_link.model_copy(update=link)}))
    return template.model_copy(update={"joint": tuple(joints), "gravity_m_s2": (0.0, 0.0, -9.8062)})


def pinocchio_model(robot: Robot) -> pinocchio.Model:
    model = pinocchio.Model()
    model.gravity.linear = np.array(robot.gravity_m_s2)
    parent, place = 0, pinocchio.SE3.Identity()
    for joint in robot.joint:
        link = joint.link
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), place, joint.name)
        twist = pinocchio.utils.rotate("x", np.radians(link.alpha_deg))
        place = pinocchio.SE3(twist, np.array([link.a_m, 0.0, link.d_m]))
        inertia = pinocchio.Inertia(link.mass_kg, np.array(link.centre_of_mass_m), np.diag(link.inertia_kg_m2))
        model.appendBodyToJoint(parent, inertia, place)
    return model


def toolbox_model(robot: Robot) -> "roboticstoolbox.DHRobot":
    links = [
        roboticstoolbox.RevoluteDH(
            a=link.a_m,
            d=link.d_m,
            alpha=np.radians(link.alpha_deg),
            m=link.mass_kg,
            r=list(link.centre_of_mass_m),
            I=[*link.inertia_kg_m2, 0.0, 0.0, 0.0],
        )
        for link in (joint.link for joint in robot.joint)
    ]
    return roboticstoolbox.DHRobot(links, gravity=np.array(robot.gravity_m_s2))
