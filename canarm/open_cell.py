"""The cell that a command or a rig is given: by name or file, with settings laid over it.

Where these change the object that two robots carry, the slave is parked where it then holds it, and what the cards give
robots that carry without a controller is that pose's.
"""

from collections.abc import Mapping

from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell, Robot
from canarm_protocol.errors import CellError


def open_cell(name_or_path: str, settings: Mapping[str, str] | None = None, *, option: str = "--set") -> Cell:
    """As `load_cell`, and with the slave's `home_deg`, and error values that carry, where the settings change them.

    Raises `CellError`, also for an object at which the slave cannot be parked, with the reason.
    """
    cell = load_cell(name_or_path, settings, option=option)
    moved = [f"{option} {key}={value}" for key, value in (settings or {}).items() if key.startswith("object.")]
    if not moved or cell.object is None:
        return cell
    from canarm_controller.errors import ControllerError
    from canarm_controller.reference.carried_motion import slave_home_deg

    from .carrying_values import with_carrying_values

    try:
        home_deg = slave_home_deg(cell)
    except ControllerError as error:
        raise CellError(f"cell {cell.name} with {', '.join(moved)}: {error}") from None
    slave = cell.object.slave
    robots = tuple(_parked(robot, home_deg) if robot.name == slave else robot for robot in cell.robot)
    return with_carrying_values(cell.model_copy(update={"robot": robots}))


def _parked(robot: Robot, home_deg: tuple[float, ...]) -> Robot:
    rows = zip(robot.joint, home_deg, strict=True)
    return robot.model_copy(
        update={"joint": tuple(joint.model_copy(update={"home_deg": home}) for joint, home in rows)}
    )
