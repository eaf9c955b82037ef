"""Cells in the old format: one line says how to write them now."""

from collections.abc import Iterator, Mapping
from typing import Any

_NOW = (
    'is written the old way; a drive is now [robot.joint.drive] with kind = "d669", and each sensor has a table of its '
    "own: [robot.joint.sensors.potentiometer] range_deg, zero_v, full_scale_v, noise_lsb; "
    "[robot.joint.sensors.tachometer] full_scale_rad_s, ...; [robot.joint.sensors.current_sense] full_scale_a, ..."
)
_OLD_SENSORS = ("potentiometer_range_deg", "tachometer_full_scale_rad_s", "current_sense_full_scale_a")


def old_writing(table: Mapping[str, Any]) -> str | None:
    """The key of a cell's `table` that is written the old way, and how to write it now; None if there is none."""
    for joint in _joints(table):
        sensors = joint.get("sensors")
        flat = isinstance(sensors, Mapping) and next((key for key in _OLD_SENSORS if key in sensors), None)
        key = "amplifier" if "amplifier" in joint else f"sensors.{flat}" if flat else None
        if key:
            return f"joint {joint.get('name')!r}.{key}: {_NOW}"
    return None


def _joints(table: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    for robot in _tables(table.get("robot")):
        yield from _tables(robot.get("joint"))


def _tables(value: Any) -> Iterator[Mapping[str, Any]]:
    if isinstance(value, list | tuple):
        yield from (each for each in value if isinstance(each, Mapping))
