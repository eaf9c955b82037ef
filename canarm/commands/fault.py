"""`canarm fault`: what can be injected where, and faults on a running bench."""

import contextlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from canarm_protocol.errors import FaultError
from canarm_protocol.faults.bench_client import BenchClient
from canarm_protocol.faults.fault_toml import as_toml
from canarm_protocol.faults.script import FaultScript, script_of

from ..fault_text import catalogue_lines, parse_parameters, select_taps, status_lines
from ..options import BenchAttachOptions, CellOptions, Flag, Seconds, named_file, whole_number
from ..rig.rig_faults import read_script
from ..usage import UsageError

NAMED = "tap and fault"

fault = App(name="fault", help="Break something on the signal path, and mend it again.")
fault.command(
    "canarm.commands.fault_matrix:matrix", name="matrix", help="Run every fault at every tap: what notices which?"
)


@fault.command(name="list")
def list_(
    *,
    cell: CellOptions = CellOptions(),
    tap: Annotated[
        str | None, Parameter(metavar="NAME", help="This tap only, or those that match, as 'joint2.*'.")
    ] = None,
    json_: Annotated[Flag, Parameter(name="--json", help="As JSON.")] = False,
) -> int:
    """Show the taps of a cell, the faults that each supports, and their parameters: default, limits, unit.

    Needs no running bench.
    """
    # Imports every fault; the other commands leave that to the bench.
    from canarm_emulator.faults.catalogue import as_plain, catalogue_of

    taps = select_taps(as_plain(catalogue_of(cell.load())), tap)
    print(json.dumps(taps) if json_ else "\n".join(catalogue_lines(taps)))
    return 0


@fault.command
def inject(
    tap: Annotated[str | None, Parameter(name="TAP", help="Where, such as joint2.tachometer.")] = None,
    fault_: Annotated[str | None, Parameter(name="FAULT", help="What, such as stuck.")] = None,
    /,
    *parameters: Annotated[
        str, Parameter(name="KEY=VALUE", help="The fault's parameters; whole numbers may be 0x….", show_env_var=False)
    ],
    file: Annotated[
        Path | None,
        Parameter(metavar="FILE", converter=named_file, help="A fault file instead of TAP and FAULT."),
    ] = None,
    name: Annotated[str | None, Parameter(metavar="NAME", help="Name of the set, for clear and trigger.")] = None,
    at: Annotated[
        float | None,
        Parameter(metavar="SECONDS", help="Begin so long after cycle 0 of the run; at once unless given, or over."),
    ] = None,
    cycle: Annotated[
        int | None, Parameter(converter=whole_number, metavar="NUMBER", help="Begin with this cycle.")
    ] = None,
    when: Annotated[
        str | None, Parameter(metavar="CONDITION", help="Begin as soon as it holds, as 'joint2.angle_deg > 30'.")
    ] = None,
    manual: Annotated[Flag, Parameter(help="Wait for `canarm fault trigger`.")] = False,
    duration: Annotated[Seconds | None, Parameter(show_default=False, help="Time until it ends by itself.")] = None,
    repeat: Annotated[
        int | None, Parameter(converter=whole_number, metavar="TIMES", help="Activations in all; needs a duration.")
    ] = None,
    period: Annotated[
        Seconds | None, Parameter(show_default=False, help="Time from one activation to the next.")
    ] = None,
    cell: CellOptions = CellOptions(),
    bench: BenchAttachOptions = BenchAttachOptions(),
) -> int:
    """Inject a fault, or all that a fault file says, into a running bench."""
    trigger = {"at": at, "cycle": cycle, "when": when, "manual": manual or None}
    given = {**trigger, "duration": duration, "repeat": repeat, "period": period, "name": name}
    given = {key: value for key, value in given.items() if value is not None}
    if file is None:
        if tap is None or fault_ is None:
            raise UsageError("fault inject: name TAP and FAULT, or a --file; both are in `canarm fault list`")
        spec = {**parse_parameters(parameters), "tap": tap, "fault": fault_}
    elif tap is not None or given:
        surplus = NAMED if tap is not None else f"--{next(iter(given))}"
        raise UsageError(f"--file {file}: says all by itself; leave {surplus} out")
    with _client(cell, bench) as client:
        if file is not None:
            print(client.inject(as_toml(_checked_file(file))))
        else:
            given.setdefault("name", _free_name(f"{tap} {fault_}", client.status()))
            print(client.inject(as_toml(script_of({"set": [{**given, "fault": [spec]}]}, "fault inject"))))
    return 0


@fault.command
def clear(
    name: Annotated[str | None, Parameter(name="NAME", help="Name of a set; all sets unless given.")] = None,
    /,
    *,
    cell: CellOptions = CellOptions(),
    bench: BenchAttachOptions = BenchAttachOptions(),
) -> int:
    """End and forget faults of a running bench."""
    with _client(cell, bench) as client:
        print(client.clear(name))
    return 0


@fault.command
def trigger(
    name: Annotated[str, Parameter(name="NAME", help="Name of a set that waits.")],
    /,
    *,
    cell: CellOptions = CellOptions(),
    bench: BenchAttachOptions = BenchAttachOptions(),
) -> int:
    """Let a set begin that waits, for this or for its own trigger."""
    with _client(cell, bench) as client:
        print(client.trigger(name))
    return 0


@fault.command
def status(
    *,
    cell: CellOptions = CellOptions(),
    bench: BenchAttachOptions = BenchAttachOptions(),
    json_: Annotated[Flag, Parameter(name="--json", help="As one JSON object.")] = False,
) -> int:
    """Show whether a run is on, the sets of a running bench, which faults act now, and what controllers detected."""
    with _client(cell, bench) as client:
        found = {**client.status(), "detections": client.detections()}
    print(json.dumps(found) if json_ else "\n".join(status_lines(found)))
    return 0


@contextlib.contextmanager
def _client(cell: CellOptions, bench: BenchAttachOptions) -> Iterator[BenchClient]:
    nominal, named = cell.load(), bench.named()
    with named.open() as port, BenchClient(port, nominal) as client:
        yield client


def _checked_file(path: Path) -> FaultScript:
    script = read_script(path)
    if not script.sets and script.clear == "":
        raise FaultError(f"{path}: has no [[set]]; to clear all faults: canarm fault clear")
    return script


def _free_name(wanted: str, status: Mapping[str, Any]) -> str:
    """`wanted`, with a number appended if a set already has that name."""
    taken = {each["set"] for each in status["sets"]}
    number, name = 1, wanted
    while name in taken:
        number += 1
        name = f"{wanted} #{number}"
    return name
