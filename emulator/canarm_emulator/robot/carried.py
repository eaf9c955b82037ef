"""The object that two robots carry: its grips, their forces, and how it is lost.

Gives MJCF its body and its pin. `Plant` steps; here is only what hangs between the hands.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import mul
from typing import Any, NamedTuple, Self
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import Carried, Cell, Vector

from ..errors import TruthError
from .hands import MASTER, SLAVE, Hands
from .poses import Pose, Quaternion
from .segments import segments_of
from .truth import ObjectTruth

BODY, PIN = "object", "slave grip"
GRIP_LOST = "grip-lost"
"""The event of a hand that has lost the object."""
_PIN = {
    # Two thirds of a millisecond a step: as stiff as MuJoCo lets it be, and critically damped.
    "solref": "0.002 1",
    "solimp": "0.99 0.999 0.001 0.5 2",
}
_SOFT, _STIFF = 1e-4, (0.99, 0.999)
"""Of `solimp`: the share of a misfit that is taken out, when pads touch (MuJoCo's least) and when they are pressed."""
_NOTHING = 1e-9  # kg and kg m2: an object that is no longer there
PAD_S = 0.01
"""Time in which the pads of a hand give way: rubber of some 80 kN/m under the 8 kg that an arm of `rhino-pair` weighs
at its hand, sqrt(8 / 80e3) s; assumed. What is shorter they take up. Rigid arms that hit something make any force, for
one step of the integration; through pads it is their momentum over this time, however short the step."""


class ObjectState(NamedTuple):
    """The object now, in the world's frame; forces are those of the hands on the object, as their pads pass them on.

    `position_m` is the master's grip, x of `quaternion` points along the object. `squeeze_n` is the slave's force along
    it: positive where the hands press it together. A grip that is lost has no force.
    """

    position_m: Vector
    quaternion: Quaternion
    master_force_n: Vector
    slave_force_n: Vector
    squeeze_n: float
    is_in_master: bool
    is_in_slave: bool
    is_on_stand: bool = False
    """Whether a stand bears all or a part of it still."""

    @property
    def lost(self) -> tuple[str, ...]:
        """The hands that hold it no longer: "master", "slave"; none of an object that waits on its stand."""
        held = ((MASTER, self.is_in_master), (SLAVE, self.is_in_slave))
        return () if self.is_on_stand else tuple(name for name, is_held in held if not is_held)


@dataclass(slots=True)
class GripFigures:
    """The hands' forces since power-on, as their pads pass them on, taken in every step of the integration."""

    master_peak_n: float = 0.0
    slave_peak_n: float = 0.0
    squeeze_peak_n: float = 0.0
    squeeze_squares: float = 0.0
    steps: int = 0

    def as_plain(self, slip_force_n: float, lost: tuple[str, ...]) -> dict[str, Any]:
        """For a summary: peaks and RMS in N, and the hands that have lost the object."""
        return {
            "grip_peak_n": max(self.master_peak_n, self.slave_peak_n),
            "slip_force_n": slip_force_n,
            "squeeze_rms_n": math.sqrt(self.squeeze_squares / self.steps) if self.steps else 0.0,
            "squeeze_peak_n": self.squeeze_peak_n,
            "lost_by": list(lost),
        }


def hand(robot: str) -> str:
    """Name of the body at the end of a robot that carries."""
    return f"{robot}.hand"


def add_object(hand_element: ElementTree.Element, cell: Cell, truth: ObjectTruth) -> None:
    """Add the object to the master's last body: it moves with the hand, and stays a body of its own."""
    carried = cell.object
    assert carried is not None
    tool = _tool(cell, carried.master)
    along = Pose(quaternion=_along(carried.direction))
    pose = tool.then(along)
    body = ElementTree.SubElement(
        hand_element, "body", name=BODY, pos=text_of(*pose.position_m), quat=text_of(*pose.quaternion)
    )
    axial, across = (moment * truth.mass_kg / carried.mass_kg for moment in carried.moments_kg_m2)
    centre = text_of(carried.length_m / 2, 0.0, 0.0)
    ElementTree.SubElement(
        body, "inertial", pos=centre, mass=text_of(truth.mass_kg), diaginertia=text_of(axial, across, across)
    )


def add_pin(root: ElementTree.Element, carried: Carried) -> None:
    """Add the slave's grip: one point of the object and one of the hand coincide."""
    equality = ElementTree.SubElement(root, "equality")
    anchor = text_of(carried.grasp_distance_m, 0.0, 0.0)
    bodies = {"body1": BODY, "body2": hand(carried.slave)}
    ElementTree.SubElement(equality, "connect", {"name": PIN, **bodies, "anchor": anchor, **_PIN})


class Grips:
    """Both hands on the object, in the model and state of a `Plant`."""

    __slots__ = (
        "_active", "_along", "_body", "_bulk", "_carried", "_data", "_hand", "_hands", "_inner_n", "_master_n",
        "_model", "_own_n", "_place", "_share", "_slave_n", "_slip_n", "_stand", "_step_s", "_tools", "_turn",
        "figures", "is_in_master",
    )  # fmt: skip

    def __init__(self, cell: Cell, truth: ObjectTruth, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        assert cell.object is not None
        self._carried, self._model, self._data = cell.object, model, data
        self._body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, BODY)
        self._hand = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, hand(cell.object.slave))
        # What MuJoCo keeps in one place for good; an attribute of its data is a new object each time.
        self._active = data.eq_active.data
        self._place: Callable[[], Any] = elements(data.xpos[self._body]).tolist
        self._turn: Callable[[], Any] = elements(data.xquat[self._body]).tolist
        self._along: Callable[[], Any] = elements(data.xmat[self._body]).tolist
        self._inner_n: Callable[[], Any] = elements(data.cfrc_int[self._body, 3:]).tolist
        self._step_s = self._share = 0.0
        self._slip_n = truth.slip_force_n
        self._bulk = float(model.body_mass[self._body]), model.body_inertia[self._body].copy()
        self._own_n = data.xfrc_applied[self._body].copy()
        self._tools = [_tool(cell, name).position_m for name in (cell.object.master, cell.object.slave)]
        self._hands, self._stand = Hands(cell.object), Pose()
        self.is_in_master = True
        self._master_n = self._slave_n = (0.0, 0.0, 0.0)
        self.figures = GripFigures()

    def begin(self, cell: Cell) -> None:
        """The object is in both hands, or on its stand, where hands at home hold it: as the cell has it.

        Raises `TruthError` if the slave's hand is not at it.
        """
        if self._hands.borne:
            self._put_down(cell)
        else:
            self._close()

    def _close(self) -> None:
        """The slave's hand closes where it is: there it holds the object."""
        carried = self._carried
        mujoco.mj_kinematics(self._model, self._data)
        away_m = self._pin(self._point())
        if away_m > carried.diameter_m:
            raise TruthError(
                f"object: the hand of {carried.slave!r} is {away_m * 1e3:.3g} mm from where it is to hold it, "
                f"{carried.grasp_distance_m:g} m from the hand of {carried.master!r}; at most its diameter, "
                f"{carried.diameter_m * 1e3:g} mm: park the robots otherwise"
            )

    def _pin(self, point: np.ndarray) -> float:
        """The slave's hand holds this point of the world. Returns how far it is from where the hand holds things, m."""
        turn = self._data.xmat[self._hand].reshape(3, 3)
        anchor = turn.T @ (point - self._data.xpos[self._hand])
        self._model.eq_data[0, 3:6] = anchor
        return math.dist(anchor, self._tools[1])

    def _put_down(self, cell: Cell) -> None:
        """The object lies where the hands are at home, and both hands are open."""
        data, body = self._data, self._body
        angles = data.qpos.copy()
        data.qpos[: len(cell.joints)] = [math.radians(joint.home_deg) for joint in cell.joints]
        mujoco.mj_kinematics(self._model, data)
        x, y, z = data.xpos[body].tolist()
        turn_w, turn_x, turn_y, turn_z = data.xquat[body].tolist()
        self._stand = Pose((x, y, z), (turn_w, turn_x, turn_y, turn_z))
        data.qpos[:] = angles
        self.open_master()

    def command(self, hand: str, bits: int) -> None:
        """What the latch tells the motor of the "master"'s hand or the "slave"'s, see `HandBits`."""
        self._hands.each[hand].bits = bits

    @property
    def moves(self) -> bool:
        """Whether a hand moves, or the stand."""
        return self._hands.moves

    def wait(self, step_s: float) -> None:
        """Let the hands and the stand move."""
        hands = self._hands
        for name in hands.move(step_s):
            if hands.each[name].is_open:
                self.open(name)
            elif hands.borne == 1.0 and not any(hand.is_open for hand in hands.each.values()):
                self._take_hold()
        if self.is_in_master and hands.borne == 1.0 and hands.firmness == 1.0:
            hands.take_up()
        self._press()

    def _take_hold(self) -> None:
        """Both hands touch the object on its stand: they hold what is between them, where it lies."""
        model, data, body, stand = self._model, self._data, self._body, self._stand
        mujoco.mj_kinematics(model, data)
        hand = model.body_parentid[body]
        place, turn = data.xpos[hand], data.xmat[hand].reshape(3, 3)
        along = np.zeros(9)
        mujoco.mju_quat2Mat(along, np.array(stand.quaternion))
        begin = np.array(stand.position_m)
        away_m = math.dist(place + turn @ self._tools[0], stand.position_m)
        point = begin + along[::3] * self._carried.grasp_distance_m
        away_m = max(away_m, self._pin(point))
        if away_m > self._carried.diameter_m:
            return  # a hand has closed on nothing, and the object stays
        back, quaternion = np.zeros(4), np.zeros(4)
        mujoco.mju_negQuat(back, data.xquat[hand])
        mujoco.mju_mulQuat(quaternion, back, np.array(stand.quaternion))
        model.body_pos[body], model.body_quat[body] = turn.T @ (begin - place), quaternion
        self._weigh(*self._bulk)
        self._pin(point)  # which setting constants has set as at angles 0
        data.eq_active[0] = 1
        self.is_in_master = True

    def _press(self) -> None:
        """How stiff the pads of the slave's hand are, and the stand's force, at the centre of mass."""
        soft = 1.0 - self._hands.firmness
        self._model.eq_solimp[0, :2] = [stiff * (_SOFT / stiff) ** soft for stiff in _STIFF]
        weight_n = self._bulk[0] * self._model.opt.gravity + self._own_n[:3]
        force_n = self._own_n[:3] - self._hands.borne * weight_n
        self._data.xfrc_applied[self._body, :3] = force_n if self.is_in_master else 0.0

    def look(self, step_s: float) -> None:
        """After a step of `step_s`: the forces in it, and whether a grip slips."""
        if step_s != self._step_s:
            self._step_s, self._share = step_s, -math.expm1(-step_s / PAD_S)
        if self._hands.moves:
            self.wait(step_s)
        figures, share = self.figures, self._share
        figures.steps += 1
        if self._active[0]:
            x, y, z = self._slave_n = _towards(self._slave_n, self._pin_force(), share)
            strength_n = math.hypot(x, y, z)
            if strength_n > figures.slave_peak_n:
                figures.slave_peak_n = strength_n
            a, _, _, b, _, _, c, _, _ = self._along()
            squeeze_n = abs(a * x + b * y + c * z)
            if squeeze_n > figures.squeeze_peak_n:
                figures.squeeze_peak_n = squeeze_n
            figures.squeeze_squares += squeeze_n * squeeze_n
            if strength_n > self._slip_n:
                self.open_slave()
        if self.is_in_master:
            mujoco.mj_rnePostConstraint(self._model, self._data)
            x, y, z = self._master_n = _towards(self._master_n, self._inner_n(), share)
            strength_n = math.hypot(x, y, z)
            if strength_n > figures.master_peak_n:
                figures.master_peak_n = strength_n
            if strength_n > self._slip_n:
                self.open_master()

    def summary(self) -> dict[str, Any]:
        """The figures so far; see `GripFigures`."""
        return self.figures.as_plain(self._slip_n, self.state().lost)

    @property
    def is_in_slave(self) -> bool:
        """Whether the slave holds the object."""
        return bool(self._active[0])

    def state(self) -> ObjectState:
        """The object after the last step."""
        if self._hands.borne == 1.0 and not self.is_in_master:
            nothing = (0.0, 0.0, 0.0)
            return ObjectState(*self._stand, nothing, nothing, 0.0, False, False, True)
        x, y, z = self._place()
        slave, master = self._slave_n, self._master_n
        squeeze_n = -sum(map(mul, slave, self._along()[::3]))
        held = self.is_in_master, self.is_in_slave, self._hands.borne > 0.0
        return ObjectState((x, y, z), self._turn(), master, slave, squeeze_n, *held)

    def take_over(self, before: Self) -> None:
        """Hold the object as it was held."""
        self._hands.take_over(before._hands)
        body = self._body
        for values in ("body_pos", "body_quat"):
            getattr(self._model, values)[body] = getattr(before._model, values)[body]
        if before.is_in_master and not self.is_in_master:
            self._weigh(*self._bulk)
            self.is_in_master = True
        self._press()
        self._model.eq_data[0] = before._model.eq_data[0]
        self._data.eq_active[0] = before._data.eq_active[0]
        self.figures, self._slave_n, self._master_n = before.figures, before._slave_n, before._master_n
        if not before.is_in_master:
            self.open_master()

    def open(self, hand: str) -> None:
        """The "master"'s hand or the "slave"'s lets go."""
        if hand == MASTER:
            self.open_master()
        else:
            self.open_slave()

    def open_slave(self) -> None:
        """The slave has lost the object: the master holds it alone."""
        self._data.eq_active[0] = 0
        self._slave_n = (0.0, 0.0, 0.0)

    def open_master(self) -> None:
        """The master has lost the object: it falls, and no hand holds it any more."""
        self.open_slave()
        self.is_in_master = False
        self._master_n = (0.0, 0.0, 0.0)
        self._weigh(_NOTHING, _NOTHING)

    def _weigh(self, mass_kg: float, moments_kg_m2: "float | np.ndarray") -> None:
        self._model.body_mass[self._body] = mass_kg
        self._model.body_inertia[self._body] = moments_kg_m2
        angles = self._data.qpos.copy()
        mujoco.mj_setConst(self._model, self._data)
        self._data.qpos[:] = angles
        mujoco.mj_kinematics(self._model, self._data)

    def _point(self) -> np.ndarray:
        turn = self._data.xmat[self._body].reshape(3, 3)
        return np.asarray(self._data.xpos[self._body] + turn[:, 0] * self._carried.grasp_distance_m)

    def _pin_force(self) -> Sequence[float]:
        """Of the slave's hand on the object; an equality's rows come first. None while both robots are parked."""
        forces_n = self._data.efc_force
        return forces_n[:3].tolist() if len(forces_n) else (0.0, 0.0, 0.0)


def _tool(cell: Cell, robot: str) -> Pose:
    """The tool frame of a robot in its last body."""
    (joints,) = (each.joint for each in cell.robot if each.name == robot)
    return segments_of(joints)[-1].end


def _along(direction: Vector) -> Quaternion:
    """A turn that takes x to `direction`."""
    x, y, z = direction
    if x < -1.0 + 1e-12:
        return 0.0, 0.0, 0.0, 1.0
    w = math.sqrt((1.0 + x) / 2)
    return w, 0.0, -z / (2 * w), y / (2 * w)


def _towards(force_n: Vector, new_n: Sequence[float], share: float) -> Vector:
    """A `share` of the way from one force to another."""
    x, y, z = force_n
    new_x, new_y, new_z = new_n
    return x + share * (new_x - x), y + share * (new_y - y), z + share * (new_z - z)


def elements(values: NDArray[np.float64]) -> "memoryview[float]":
    """The numbers of an array where they are: one takes a third of the time that it takes from an array."""
    return values.data.cast("B").cast("d")


def text_of(*numbers: float) -> str:
    """Numbers as an attribute of MJCF, to the last bit."""
    return " ".join(map(repr, numbers))
