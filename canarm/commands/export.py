"""`canarm export`: files that describe a cell to other tools."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from canarm_protocol.cell.export import BUSES, export_dbc, export_dcf, export_dcfgen, export_eds
from canarm_protocol.runs.own_file import replace_files
from canarm_protocol.runs.tentative import Tentative

from ..options import CellOptions
from ..usage import UsageError

EXPORTERS = {"eds": export_eds, "dcf": export_dcf, "dcfgen": export_dcfgen, "dbc": export_dbc}


def export(
    format_: Annotated[
        Literal["eds", "dcf", "dcfgen", "dbc"],
        Parameter(
            name="FORMAT",
            help="eds: data sheets; dcf: configured cards, for any master; dcfgen: bus.yml for Lely's dcfgen and "
            "ros2_canopen, with data sheets; dbc: CAN databases.",
        ),
    ],
    /,
    *,
    cell: CellOptions = CellOptions(),
    bus: Annotated[
        Literal["can0", "bench"] | None,
        Parameter(help="Of a dbc: only this bus. Without --out it is can0."),
    ] = None,
    out: Annotated[
        Path | None, Parameter(metavar="DIR", help="Folder to write into; without it a dbc goes to stdout.")
    ] = None,
) -> int:
    """Describe a cell to other tools: EDS, DCF and bus.yml for CANopen masters, DBC for whatever decodes CAN."""
    if bus is not None and format_ != "dbc":
        raise UsageError(f"--bus {bus}: only a dbc has one file per bus; leave it out")
    if out is None and format_ != "dbc":
        raise UsageError(f"export {format_}: writes several files; name a folder with --out DIR")
    texts = EXPORTERS[format_](cell.load())
    if format_ == "dbc" and (out is None or bus is not None):
        names = dict(zip(BUSES, texts, strict=True))
        wanted = names[bus or BUSES[0]]
        texts = {wanted: texts[wanted]}
    if out is None:
        print(*texts.values(), sep="", end="")
    else:
        _write(out, texts)
    return 0


def _write(folder: Path, texts: dict[str, str]) -> None:
    """All the files, or none and no new folder."""
    made = Tentative()
    try:
        made.folder(folder)
    except OSError as error:
        raise UsageError(f"--out {folder}: is no folder and cannot become one: {error.strerror}") from None
    try:
        replace_files({folder / name: text.encode("ascii") for name, text in texts.items()})
    except OSError as error:
        made.take_back()
        name = Path(str(error.filename)).name
        raise UsageError(f"--out {folder}: {name} cannot be written: {error.strerror}") from None
    for name in texts:
        print(folder / name)
