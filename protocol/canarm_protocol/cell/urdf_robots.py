"""Replaces `urdf = "arm.urdf"` of a robot by bodies and limits when the cell is loaded.

The cell is then self-contained. `urdf.py` reads the file; the schema checks the result.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import CellError
from .urdf import UrdfJoint, read_urdf

ROUNDING_DEG = 1e-6
"""A cell's limit in degrees may exceed the file's in radians by this much, from rounding."""


def resolve_urdf(table: Mapping[str, Any], folder: Path, source: str) -> None:
    """Replace `urdf` in each robot of the cell's `table` by a `body` per joint, and limits where none are given.

    `folder` is the folder of the cell's file, `source` names it in errors. What does not look like a cell is left to
    the schema. Raises `CellError`, one line.
    """
    robots = table.get("robot")
    for robot in robots if isinstance(robots, list) else ():
        if not isinstance(robot, dict) or "urdf" not in robot:
            continue
        where = f"{source}: robot {robot.get('name', '')!r}"
        path = robot.pop("urdf")
        if not isinstance(path, str) or not path:
            raise CellError(f'{where}.urdf: must be the name of a file in "quotes", such as "arm.urdf"')
        joints = read_urdf(folder / path)
        tables = robot.get("joint")
        given = tables if isinstance(tables, list) else []
        names = [each.get("name") if isinstance(each, dict) else None for each in given]
        wanted = [joint.name for joint in joints]
        if names != wanted:
            raise CellError(
                f"{where}.joint: named {_listed(names)}; those of {path}, base to tip, are {_listed(wanted)}, and each "
                "needs its table with motor, drive and sensors"
            )
        for each, joint in zip(given, joints, strict=True):
            _complete(each, joint, f"{source}: joint {joint.name!r}", path)


def _complete(table: dict[str, Any], joint: UrdfJoint, where: str, path: str) -> None:
    for key in ("body", "link"):
        if key in table:
            raise CellError(f"{where}.{key}: {path} says what the joint carries; leave this table out")
    table["body"] = joint.body()
    limits = table.setdefault("limits_deg", list(joint.limits_deg))
    if joint.is_continuous or not isinstance(limits, list) or len(limits) != 2:
        return
    low, high = joint.limits_deg
    if all(isinstance(each, int | float) for each in limits) and not (
        low - ROUNDING_DEG <= limits[0] and limits[1] <= high + ROUNDING_DEG
    ):
        raise CellError(
            f"{where}.limits_deg = {limits}: {path} has [{low:.6g}, {high:.6g}]; a cell may narrow them, not widen"
        )


def _listed(names: list[Any]) -> str:
    return ", ".join(map(str, names)) or "none"
