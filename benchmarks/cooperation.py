"""Two arms and an object: the time that a plan takes against the time that it is for, and kinematics against Pinocchio.

Seconds of CPU against seconds of the path, so that other work on the machine does not count.
"""

import statistics
import time
from collections.abc import Callable

import numpy as np
import pinocchio
from measure import Ratio, Row

from canarm.cooperation import (
    RHINO_XR,
    ArmPair,
    CarriedObject,
    circle,
    forward,
    inverse,
    plan_cooperation,
    reachability,
)

BLOCKS = 7
POSES = 100_000
LOOP = "Pinocchio, forward kinematics in a loop"
START = np.radians([0.0, -80.0, 90.0, -10.0, 90.0])
PAIR = ArmPair(master=RHINO_XR, slave=RHINO_XR, carried=CarriedObject(length_m=0.6), slave_base_m=(-0.28, -0.30, 0.0))


def rows() -> list[Row]:
    """A path of 60 s at 400 Hz, a map of 10^4 bases, and 10^5 poses there and back."""
    minute = circle(laps=12)
    grid = np.linspace(-1.0, 1.0, 100)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, 5))
    poses = forward(RHINO_XR, q)
    loop, found = loop_of_pinocchio(q[:5000])
    np.testing.assert_allclose(found, poses[:5000], atol=1e-14)
    planned = spent(lambda: plan_cooperation(PAIR, minute, START))
    mapped = spent(lambda: reachability(PAIR, circle(period_s=0.1), START, grid, grid))
    there, back = spent(lambda: forward(RHINO_XR, q)), spent(lambda: inverse(RHINO_XR, poses))
    theirs = [each * POSES / 5000 for each in spent(loop)]
    return [
        row(f"plan, both robots, {len(minute)} poses", "1 s", planned, [1.0] * BLOCKS, "<= 1"),
        row("map, 10^4 bases, 51 poses each", "1 s", mapped, [1.0] * BLOCKS, ""),
        row("forward kinematics, 10^5 poses", LOOP, there, theirs, "<= 1"),
        row("inverse kinematics, 10^5 poses x 4", LOOP, back, theirs, ""),
    ]


def row(what: str, against: str, ours: list[float], theirs: list[float], goal: str) -> Row:
    return Row(what, against, Ratio.of(ours, theirs), goal, f"{statistics.median(ours):.3f} s of CPU")


def spent(function: Callable[[], object]) -> list[float]:
    """Seconds of CPU of each of `BLOCKS` calls, after one that fills the caches."""
    function()
    seconds = []
    for _ in range(BLOCKS):
        started = time.process_time()
        function()
        seconds.append(time.process_time() - started)
    return seconds


def loop_of_pinocchio(q: np.ndarray) -> tuple[Callable[[], object], np.ndarray]:
    """The tip's pose of each row of q, as its users call it; and the poses."""
    model, parent, place = pinocchio.Model(), 0, pinocchio.SE3.Identity()
    for d, a, alpha in zip(RHINO_XR.d_m, RHINO_XR.a_m, RHINO_XR.alpha_deg, strict=True):
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), place, f"joint{parent + 1}")
        place = pinocchio.SE3(pinocchio.utils.rotate("x", np.radians(alpha)), np.array([a, 0.0, d]))
    model.addFrame(pinocchio.Frame("tip", parent, place, pinocchio.FrameType.OP_FRAME))
    data, tip = model.createData(), model.getFrameId("tip")

    def loop() -> list[object]:
        found = []
        for each in q:
            pinocchio.framesForwardKinematics(model, data, each)
            found.append(data.oMf[tip].homogeneous)
        return found

    return loop, np.array(loop())
