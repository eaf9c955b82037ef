"""A serial arm from a URDF file: the revolute joints from base to tip with the bodies that they carry.

urdf_parser_py, an extra of this distribution, reads the file. Here links behind fixed joints are joined to the body
that carries them, and what no cell can hold is refused. Motors, sensors and cards come from the cell and never enter.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import CellError
from ..shown import first_line, printable
from ..text_file import read_text
from .inertia import is_possible
from .rigid import IDENTITY, Inertial, Pose, Triple, from_rpy, to_rpy
from .urdf_numbers import number_problem

LARGEST_BYTES = 2_000_000
"""Largest URDF file; that of a humanoid with 60 links has about 100 kB."""
MOST_JOINTS = 7
CONTINUOUS_DEG = (-180.0, 180.0)
"""Limits of a continuous joint, whose potentiometer has ends all the same."""
KEPT = {"link": {"inertial"}, "joint": {"origin", "axis", "parent", "child", "limit", "dynamics", "mimic"}}
"""Elements that are read; shapes, materials, transmissions and simulators' own tags do not affect the motion."""
EXTRA = "canarm-protocol[urdf]"


@dataclass(frozen=True)
class UrdfJoint:
    """One revolute joint and what it carries, in the terms of a cell's `Body`; units in the names.

    `name` is the file's name in the letters that a cell allows; `velocity_rad_s`, `effort_nm`, `damping_nm_s` and
    `friction_nm` are the file's values, or 0.
    """

    name: str
    urdf_name: str
    limits_deg: tuple[float, float]
    is_continuous: bool
    origin_m: Triple
    origin_rpy_deg: Triple
    axis: Triple
    mass_kg: float
    centre_of_mass_m: Triple
    inertia_kg_m2: tuple[float, float, float, float, float, float]
    velocity_rad_s: float
    effort_nm: float
    damping_nm_s: float
    friction_nm: float

    def body(self) -> dict[str, Any]:
        """The table `body` of a cell's joint."""
        return {
            "origin_m": self.origin_m,
            "origin_rpy_deg": self.origin_rpy_deg,
            "axis": self.axis,
            "mass_kg": self.mass_kg,
            "centre_of_mass_m": self.centre_of_mass_m,
            "inertia_kg_m2": self.inertia_kg_m2,
        }


def read_urdf(path: Path) -> tuple[UrdfJoint, ...]:
    """The joints of the arm in the file `path`, base to tip.

    Raises `CellError`, one line: the file, the joint or link, what is wrong with it and what would be right.
    """
    source = printable(str(path))
    try:
        text = read_text(path, LARGEST_BYTES, "an arm", "URDF")
    except FileNotFoundError:
        raise CellError(f"{source}: no such file; name a URDF file, relative to the cell's folder") from None
    except OSError as error:
        raise CellError(f"{source}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise CellError(f"{source}: {error}") from None
    return parse_urdf(text, source)


def parse_urdf(text: str, source: str) -> tuple[UrdfJoint, ...]:
    """The joints of the arm in the URDF `text`; `source` names it in errors. Raises `CellError` as `read_urdf`."""
    try:
        robot = _parsed(text)
        return _chain(robot)
    except _UrdfProblem as problem:
        raise CellError(f"{source}: {problem}") from None


class _UrdfProblem(Exception):
    """What is wrong, without the file's name."""


def _parsed(text: str) -> Any:
    """The robot as urdf_parser_py has it, of the kept elements only. Raises `_UrdfProblem`."""
    try:
        from lxml import etree
        from urdf_parser_py import urdf, xml_reflection
    except ImportError as error:
        raise _UrdfProblem(f"reading URDF takes the Python package {error.name}, which comes with {EXTRA}") from None
    # Refused unread, entities and document types can neither expand nor fetch anything.
    if "<!" in re.sub(r"<!--.*?-->|<!\[CDATA\[.*?\]\]>", "", text, flags=re.DOTALL):
        raise _UrdfProblem("has a document type or an entity (<!...); a URDF file needs none, take it out")
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(text.encode(), parser)
    except etree.XMLSyntaxError as error:
        raise _UrdfProblem(f"no valid XML: {first_line(error.msg)}") from None
    except (ValueError, RecursionError) as error:
        raise _UrdfProblem(f"no valid XML: {first_line(error)}") from None
    if root.tag != "robot":
        raise _UrdfProblem(f"begins with <{root.tag}>; a URDF file begins with <robot>")
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise _UrdfProblem("has xacro macros; write it out first, with: xacro FILE > arm.urdf")
    for element in list(root):
        if element.tag not in KEPT:
            root.remove(element)
            continue
        for child in list(element):
            if child.tag not in KEPT[element.tag]:
                element.remove(child)
    problem = number_problem(root)
    if problem is not None:
        raise _UrdfProblem(problem)
    said: list[str] = []
    # The module would write its complaints to stderr.
    xml_reflection.core.on_error = said.append
    try:
        robot = urdf.Robot.from_xml(root, xml_reflection.core.Path("robot"))
    except Exception as error:  # its errors have no common class
        raise _UrdfProblem(f"no robot: {printable(' '.join(str(error).split()))}") from None
    if said:
        raise _UrdfProblem(f"no robot: {printable(' '.join(said[0].split()))}")
    return robot


def _chain(robot: Any) -> tuple[UrdfJoint, ...]:
    """Bodies and joints from base to tip. Raises `_UrdfProblem`."""
    _check_names("link", robot.links)
    _check_names("joint", robot.joints)
    links = {link.name: link for link in robot.links}
    children: dict[str, list[Any]] = {name: [] for name in links}
    parents: dict[str, Any] = {}
    for joint in robot.joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise _UrdfProblem(f"joint {joint.name!r}: there is no link {end!r}")
        if joint.child in parents:
            other = parents[joint.child].name
            raise _UrdfProblem(f"joint {joint.name!r}: link {joint.child!r} is moved by joint {other!r} already")
        parents[joint.child] = joint
        children[joint.parent].append(joint)
    roots = [name for name in links if name not in parents]
    if len(roots) != 1:
        listed = ", ".join(map(repr, roots)) or "none"
        raise _UrdfProblem(f"an arm has one base, a link that no joint moves; here are {listed}")
    below = _below(roots[0], children)
    for name in links:
        if name not in below:
            raise _UrdfProblem(f"link {name!r}: hangs in a loop of joints; an arm goes from base to tip")
    found: list[UrdfJoint] = []
    _, at, _ = _gathered(roots[0], links, children)
    names: dict[str, str] = {}
    while at is not None:
        joint, pose = at
        body, following, parts = _gathered(joint.child, links, children)
        _check_possible(body, [links[name] for name in parts])
        each = _joint(joint, pose, body)
        if each.name in names:
            raise _UrdfProblem(
                f"joints {names[each.name]!r} and {each.urdf_name!r} are both {each.name!r} in a cell; rename one"
            )
        names[each.name] = each.urdf_name
        found.append(each)
        at = following
    if not 1 <= len(found) <= MOST_JOINTS:
        raise _UrdfProblem(f"{len(found)} joints move; a cell's robot has 1 to {MOST_JOINTS}")
    return tuple(found)


def _check_names(what: str, named: Sequence[Any]) -> None:
    """Raises `_UrdfProblem` for a name that is used twice: only the last one would count."""
    name, count = Counter(each.name for each in named).most_common(1)[0] if named else ("", 0)
    if count > 1:
        raise _UrdfProblem(f"{what} {name!r}: stands there {count} times; each {what} has a name of its own")


def _below(root: str, children: Mapping[str, Sequence[Any]]) -> set[str]:
    """The links that joints lead to from `root` on, itself included."""
    found, waiting = {root}, [root]
    while waiting:
        for joint in children[waiting.pop()]:
            if joint.child not in found:
                found.add(joint.child)
                waiting.append(joint.child)
    return found


def _gathered(
    name: str, links: Mapping[str, Any], children: Mapping[str, Sequence[Any]]
) -> tuple[Inertial | None, tuple[Any, Pose] | None, list[str]]:
    """The rigid body of which link `name` is part, in the link's frame; the joint after it, with its pose there; and
    the names of the body's links.

    Raises `_UrdfProblem` if there are two joints after it.
    """
    body: Inertial | None = None
    moving: tuple[Any, Pose] | None = None
    parts: list[str] = []
    waiting = [(name, Pose())]
    while waiting:
        link, pose = waiting.pop()
        parts.append(link)
        own = _inertial(links[link])
        if own is not None:
            own = own.seen_from(pose)
            body = own if body is None else body.joined(own)
        for joint in children[link]:
            at = pose.then(_pose(joint.origin, f"joint {joint.name!r}"))
            if joint.type == "fixed":
                waiting.append((joint.child, at))
            elif moving is not None:
                raise _UrdfProblem(
                    f"joint {joint.name!r}: branches off where joint {moving[0].name!r} goes on; an arm has one joint "
                    "after the other (make those of a gripper fixed)"
                )
            else:
                moving = (joint, at)
    return body, moving, parts


def _check_possible(body: Inertial | None, links: Sequence[Any]) -> None:
    """Raises `_UrdfProblem`, with the file's own numbers, for the link whose inertia makes the body's impossible."""
    if body is None or _is_possible(body.tensor_kg_m2):
        return
    for link in links:
        inertia = link.inertial and link.inertial.inertia
        if inertia is not None and not _is_possible(inertia.to_matrix()):
            keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            listed = " ".join(f'{key}="{getattr(inertia, key):g}"' for key in keys)
            raise _UrdfProblem(
                f"link {link.name!r}: inertia {listed}: no body has it; any two of its principal moments must be at "
                "least the third together (A + B >= C)"
            )


def _is_possible(tensor: Sequence[Sequence[float]]) -> bool:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor
    return is_possible((xx, yy, zz), (xy, xz, yz))


def _joint(joint: Any, pose: Pose, body: Inertial | None) -> UrdfJoint:
    where = f"joint {joint.name!r}"
    if joint.type not in ("revolute", "continuous"):
        raise _UrdfProblem(f"{where}: is {joint.type}; a cell has revolute, continuous and fixed joints")
    if joint.mimic is not None:
        raise _UrdfProblem(f"{where}: mimics {joint.mimic.joint!r}; every joint of a cell has a drive of its own")
    if body is None or not body.mass_kg > 0.0:
        raise _UrdfProblem(f"{where}: carries no mass; give link {joint.child!r} an <inertial> with mass and inertia")
    axis = _numbers(joint.axis if joint.axis is not None else (1.0, 0.0, 0.0), f"{where}: axis")
    length = math.hypot(*axis)
    if not length > 1e-9:
        raise _UrdfProblem(f"{where}: axis {_listed(axis)} has no direction")
    tensor = body.tensor_kg_m2
    dynamics, limit = joint.dynamics, joint.limit
    return UrdfJoint(
        name=cell_name(joint.name),
        urdf_name=joint.name,
        limits_deg=_limits_deg(joint, where),
        is_continuous=joint.type == "continuous",
        origin_m=pose.origin_m,
        origin_rpy_deg=_triple(map(math.degrees, to_rpy(pose.rotation))),
        axis=_triple(each / length for each in axis),
        mass_kg=body.mass_kg,
        centre_of_mass_m=body.centre_m,
        inertia_kg_m2=(tensor[0][0], tensor[1][1], tensor[2][2], tensor[0][1], tensor[0][2], tensor[1][2]),
        velocity_rad_s=_at_least_0(limit and limit.velocity, f"{where}: limit velocity"),
        effort_nm=_at_least_0(limit and limit.effort, f"{where}: limit effort"),
        damping_nm_s=_at_least_0(dynamics and dynamics.damping, f"{where}: damping"),
        friction_nm=_at_least_0(dynamics and dynamics.friction, f"{where}: friction"),
    )


def _limits_deg(joint: Any, where: str) -> tuple[float, float]:
    if joint.type == "continuous":
        return CONTINUOUS_DEG
    if joint.limit is None:
        raise _UrdfProblem(f"{where}: is revolute and has no <limit>; give it lower and upper in rad")
    low, high = joint.limit.lower, joint.limit.upper
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise _UrdfProblem(f"{where}: limit lower = {low:g}, upper = {high:g} rad; lower must be below upper")
    return (math.degrees(low), math.degrees(high))


def _inertial(link: Any) -> Inertial | None:
    """Mass and inertia of a link in its own frame; None without any. Raises `_UrdfProblem`."""
    inertial = link.inertial
    if inertial is None:
        return None
    where = f"link {link.name!r}"
    mass_kg = inertial.mass
    if not (math.isfinite(mass_kg) and mass_kg >= 0.0):
        raise _UrdfProblem(f"{where}: mass {mass_kg:g} kg; must be a number of at least 0")
    if not mass_kg:
        return None
    rows = inertial.inertia.to_matrix() if inertial.inertia is not None else None
    if rows is None:
        raise _UrdfProblem(f"{where}: has a mass and no <inertia>")
    tensor = tuple(_numbers(row, f"{where}: inertia") for row in rows)
    pose = _pose(inertial.origin, f"{where}: inertial")
    return Inertial(mass_kg, (0.0, 0.0, 0.0), (tensor[0], tensor[1], tensor[2])).seen_from(pose)


def _pose(origin: Any, where: str) -> Pose:
    if origin is None:
        return Pose()
    xyz = _numbers(origin.xyz or (0.0, 0.0, 0.0), f"{where}: origin xyz")
    rpy = _numbers(origin.rpy or (0.0, 0.0, 0.0), f"{where}: origin rpy")
    return Pose(xyz, from_rpy(*rpy) if any(rpy) else IDENTITY)


def _numbers(values: Sequence[float], where: str) -> Triple:
    if len(values) != 3 or not all(map(math.isfinite, values)):
        raise _UrdfProblem(f"{where} is {_listed(values)}; must be three finite numbers")
    return _triple(map(float, values))


def _at_least_0(value: float | None, where: str) -> float:
    if value is None:
        return 0.0
    if not (math.isfinite(value) and value >= 0.0):
        raise _UrdfProblem(f"{where} is {value:g}; must be a number of at least 0")
    return float(value)


def cell_name(urdf_name: str) -> str:
    """A joint's name in the letters that a cell allows: `Shoulder Pan.1` becomes `shoulder_pan_1`."""
    name = re.sub(r"[^a-z0-9_-]", "_", urdf_name.lower())[:32]
    return name if name[:1].isascii() and name[:1].isalpha() else f"j{name}"[:32]


def _triple(values: Iterable[float]) -> Triple:
    x, y, z = values
    return (x, y, z)


def _listed(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{each:g}' for each in values)}]"
