"""The test bench's figures of a run, read from its node at the end, for people; a controller does not need them."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from canarm_protocol.cell import bench_objects as objects
from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import ProtocolError
from canarm_protocol.transport.sdo_session import SdoSession


@dataclass(frozen=True, slots=True)
class JointFigures:
    """Figures of one joint; None where not known.

    Errors are true minus reference, in steps of the position sensor, settling left out.
    """

    rms_lsb: float | None
    max_lsb: float | None
    peak_current_a: float
    saturated_cycles: int
    speed_ripple: float | None


def read_assessment(session: SdoSession, cell: Cell) -> dict[str, JointFigures]:
    """The bench's figures by joint name. Raises `SdoAborted`, `BusError`, or `ProtocolError` if the cell differs."""

    def number(index: int, subindex: int, format_: str = "<f") -> Any:
        data = session.upload(index, subindex)
        if len(data) != struct.calcsize(format_):
            where = f"bench object 0x{index:04X}:{subindex:02X}"
            raise ProtocolError(f"{where} has {len(data)} bytes; must be {struct.calcsize(format_)}")
        return struct.unpack(format_, data)[0]

    is_assessed = number(objects.ASSESSED_CYCLES, 0, "<I") > 0
    figures = {}
    for position, name in enumerate(cell.joint_names, start=1):
        ripple = number(objects.SPEED_RIPPLE, position)
        figures[name] = JointFigures(
            rms_lsb=number(objects.RMS_ERROR, position) if is_assessed else None,
            max_lsb=number(objects.MAX_ERROR, position) if is_assessed else None,
            peak_current_a=number(objects.PEAK_CURRENT, position),
            saturated_cycles=number(objects.SATURATED_CYCLES, position, "<I"),
            speed_ripple=ripple or None,
        )
    return figures


def name_law(session: SdoSession, law: str, names: Sequence[str]) -> None:
    """Tell the bench what the law and its internal quantities are called. Raises `SdoAborted` or `BusError`."""
    session.download(objects.LAW_NAME, 0, law.encode("ascii", "replace"))
    for position, name in enumerate(names[: objects.INTERNALS], start=1):
        session.download(objects.INTERNAL_NAME, position, name.encode("ascii", "replace"))


def tell_plan(session: SdoSession, ticks: int | None, pace: float | None) -> None:
    """Tell the bench how long the run is to last, and the pace of lockstep, times real time; None is not known.

    Raises `SdoAborted` or `BusError`.
    """
    session.download(objects.RUN_TICKS, 0, struct.pack("<I", min(ticks or 0, 0xFFFF_FFFF)))
    session.download(objects.PACE, 0, struct.pack("<f", pace or 0.0))


def tell_outcome(session: SdoSession, lines: Sequence[str]) -> None:
    """Tell the bench how the run has ended: a verdict, and a line for each detail, as many as the bench keeps.

    Raises `SdoAborted` or `BusError`.
    """
    text = ""
    for line in lines:
        longer = f"{text}\n{line}" if text else line
        if len(longer.encode()) > objects.LONGEST_OUTCOME:
            break
        text = longer
    session.download(objects.OUTCOME, 0, text.encode())
