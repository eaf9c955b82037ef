"""`canarm new-cell`: a cell for an arm of one's own, from its URDF file or from a number of joints."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.schedulability import cell_verdict
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.errors import CanarmError
from canarm_protocol.runs.own_file import create_file, replace_file

from ..announced import announced
from ..new_cell import NewCellError, Request, Sensing, write_cell
from ..new_cell.arms import SEGMENTS, arm_of_urdf, made_up_arm
from ..new_cell.request import DEFAULT_BITRATE, DEFAULT_BITS, DEFAULT_SENSING, POSITION_KINDS, Arm
from ..new_cell.timing import CYCLES_US
from ..options import Flag, named_file, whole_number
from ..rehearsal import REHEARSED_S, rehearse
from ..usage import DEFAULT_LAW, UsageError

Kinds = Literal["potentiometer", "encoder", "tachometer", "current_sense"]
PositionKinds = Literal["potentiometer", "encoder"]


def new_cell(
    *,
    urdf: Annotated[
        Path | None,
        Parameter(metavar="FILE", converter=named_file, help="The arm: bodies, axes and limits of a URDF file."),
    ] = None,
    joints: Annotated[
        int | None,
        Parameter(
            converter=whole_number, metavar="N", help="Or a made-up arm of 1 to 7 joints, for a laboratory bench."
        ),
    ] = None,
    out: Annotated[
        Path | None, Parameter(metavar="FILE", converter=named_file, help="The cell to write, such as my.toml.")
    ] = None,
    cycle_us: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            metavar="US",
            help="Period of SYNC in us; unless given 2500, or the next that the bus can carry.",
        ),
    ] = None,
    bitrate: Annotated[
        int, Parameter(converter=whole_number, metavar="BIT/S", help="Bit rate of the robot's bus.")
    ] = DEFAULT_BITRATE,
    bits: Annotated[
        int, Parameter(converter=whole_number, help="Resolution of the converters, 8 to 16.")
    ] = DEFAULT_BITS,
    sensors: Annotated[
        tuple[Kinds, ...],
        Parameter(
            negative=(),
            consume_multiple=True,
            metavar="KIND",
            show_default=" ".join,
            help="What measures each joint.",
        ),
    ] = DEFAULT_SENSING,  # type: ignore[assignment]
    position_sensor: Annotated[
        PositionKinds | None, Parameter(help="What measures each joint's angle; else as --sensors has it.")
    ] = None,
    force: Annotated[Flag, Parameter(help="Overwrite the file if it is there.")] = False,
) -> int:
    """Write a cell that runs at once: cards, wiring and gains, and motors that are strong enough, by arithmetic.

    What the arm does not say is assumed, and marked so in the file.
    """
    if out is None:
        raise UsageError("new-cell: into which file? name it with --out my.toml")
    if not force:
        _check_free(out)
    folder = out.parent
    if not folder.is_dir():
        raise UsageError(f"--out {out}: there is no folder {folder}")
    request = Request(cycle_us, bitrate, bits, _sensing(sensors, position_sensor))
    try:
        arm = _arm(urdf, joints, folder)
        with announced("choosing cycle, drives and gains"):
            text, cell = write_cell(arm, request, folder)
        with announced(f"trying the cell: {REHEARSED_S:g} s with {DEFAULT_LAW} on each built-in motion"):
            notes = list(_rehearsed(cell, arm, request, folder))
    except CanarmError as error:
        raise NewCellError(str(error).replace(":\n", ": ").replace("\n", "; ")) from None
    _write(out, text, force)
    _print(cell, out, [*_efforts(arm, cell), *notes[:-1]])
    return 0


def _rehearsed(cell: Cell, arm: Arm, request: Request, folder: Path) -> Iterator[str]:
    """As `rehearse`; of a cycle that is too long for the arm it is said which one is not."""
    try:
        yield from rehearse(cell, [DEFAULT_LAW])
    except UsageError as error:
        longest_us = _longest_cycle_us(arm, request, folder)
        if longest_us is None:
            raise
        raise UsageError(
            f"--cycle-us {request.cycle_us} is too long for this arm: {error}; --cycle-us {longest_us} works"
        ) from None


def _longest_cycle_us(arm: Arm, request: Request, folder: Path) -> int | None:
    """The longest of the usual cycles, shorter than the requested one, with which the arm runs; None without any."""
    for cycle_us in reversed([each for each in CYCLES_US if each < (request.cycle_us or 0)]):
        try:
            list(rehearse(write_cell(arm, replace(request, cycle_us=cycle_us), folder)[1], [DEFAULT_LAW]))
        except CanarmError:
            continue
        return cycle_us
    return None


def _check_free(out: Path) -> None:
    if out.is_symlink():
        raise UsageError(
            f"--out {out}: is a symbolic link; take another name, or --force to put the cell in the link's place"
        )
    if out.exists():
        raise UsageError(f"--out {out}: is there already; take another name, or --force to overwrite it")


def _sensing(sensors: Sequence[str], position_sensor: str | None) -> Sensing:
    """The kinds of sensor; if one is named for the angle, it comes first."""
    if position_sensor is not None:
        sensors = [position_sensor, *(kind for kind in sensors if kind not in POSITION_KINDS)]
    return tuple(dict.fromkeys(sensors))


def _arm(urdf: Path | None, joints: int | None, folder: Path) -> Arm:
    if urdf is not None and joints is not None:
        raise UsageError(f"new-cell: --urdf {urdf} and --joints {joints}: of which arm? take one of the two")
    if urdf is None and joints is None:
        raise UsageError("new-cell: of which arm? name its file with --urdf, or take a made-up one with --joints 3")
    if urdf is not None:
        if not urdf.exists():
            raise UsageError(f"--urdf {urdf}: there is no such file")
        return arm_of_urdf(urdf, Path(os.path.relpath(urdf, folder)).as_posix())
    if joints not in SEGMENTS:
        raise UsageError(f"--joints {joints}: must be {min(SEGMENTS)} to {max(SEGMENTS)}")
    return made_up_arm(joints)


def _write(out: Path, text: str, force: bool) -> None:
    try:
        write = replace_file if force else create_file
        write(out, text.encode())
    except OSError as error:
        raise UsageError(f"--out {out}: cannot be written: {error.strerror}") from None


def _efforts(arm: Arm, cell: Cell) -> Iterator[str]:
    """What became of the effort limits of the arm's description: drives are sized by what the arm takes."""
    stated = [(joint.name, joint.effort_nm) for joint in arm.joints if joint.effort_nm is not None]
    if stated:
        listed = ", ".join(f"{name} {effort_nm:g}" for name, effort_nm in stated)
        yield f"effort limits of the file, in N m, not used: {listed}"
    for (name, joint), own in zip(zip(cell.joint_names, cell.joints, strict=True), arm.joints, strict=True):
        torque_nm = joint.motor.torque_per_ampere * joint.drive.max_current_a
        if own.effort_nm is not None and torque_nm > own.effort_nm:
            most = f"the effort limit of {own.effort_nm:g} N m"
            yield f"joint {name}: its drive has {torque_nm:.3g} N m, more than {most}"


def _print(cell: Cell, out: Path, notes: Sequence[str]) -> None:
    for joint in cell.joints:
        torque_nm = joint.motor.torque_per_ampere * joint.drive.max_current_a
        low, high = joint.limits_deg
        print(
            f"joint {joint.name}: {low:.4g} to {high:.4g} deg, {torque_nm:.3g} N m at {joint.drive.max_current_a:g} A"
        )
    for node in card_nodes(cell):
        card = node.card
        print(
            f"card {card.name}: {card.model} in slot {card.slot}, node 0x{card.node_id:02X}, {len(card.channel)} wires"
        )
    bus = cell.bus
    print(f"bus: {bus.bitrate} bit/s, cycle {bus.cycle_us} us, load {100 * cell_verdict(cell).load:.0f} %")
    for note in notes:
        print(note)
    print(f"{out}: ready; try: canarm demo --cell {out}")
