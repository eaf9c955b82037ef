"""`canarm emulator`: the robot's side as a process of its own."""

import json
import sys
from pathlib import Path
from typing import Annotated

from canarm_emulator.bench import Bench
from canarm_emulator.errors import EmulatorError, TruthError
from canarm_emulator.hub import Hub
from canarm_emulator.recording import Recorder
from canarm_emulator.runner import BENCH_BUS, ROBOT_BUS, EmulatorRunner
from canarm_protocol.cell import Cell
from canarm_protocol.clock import Clock
from canarm_protocol.errors import BusError
from canarm_protocol.port import BusPort
from canarm_protocol.run_folder import create_run_folder, update_run_file
from cyclopts import Parameter

from ..options import DEFAULT_ADDRESS, BusOptions, CellOptions, ClockName, OutputOptions, Words, parse_address
from ..session import UsageError, make_bench, parse_settings, provenance
from ..stopping import StopRequest

def emulator(
    *,
    cell: CellOptions = CellOptions(),
    bus: BusOptions = BusOptions(),
    output: OutputOptions = OutputOptions(),
    serve: Annotated[str, Parameter(help="HOST:PORT of the virtual bus (socketcand protocol); port 0 is any free one.")]
    = DEFAULT_ADDRESS,
    allow_remote: Annotated[
        bool, Parameter(negative=(), help="Serve other machines too: anyone who reaches the port can drive the robot.")
    ] = False,
    clock: Annotated[ClockName, Parameter(help="What drives time: the wall clock, or SYNC (lockstep).")] = "wall",
    sync_timeout: Annotated[
        float, Parameter(help="Lockstep: seconds of wall time after which a silent sender of SYNC is lost.")
    ] = 2.0,
    seed: Annotated[int, Parameter(help="Seed of the sensor noise.")] = 0,
    truth: Annotated[
        Words | None, Parameter(help="KEY=VALUE: what differs from nominal in the true robot; may be repeated.")
    ] = None,
    seconds: Annotated[float | None, Parameter(help="End after so many seconds of wall time.")] = None,
    with_parent: Annotated[bool, Parameter(negative=(), show=False)] = False,
) -> int:
    """Emulate the robot: cards, electrics, arm and both buses. Ends on Ctrl-C.

    Prints how to attach to each bus with python-can's flags.
    """
    nominal = cell.load()
    if sync_timeout <= 0.0:
        raise UsageError(f"--sync-timeout {sync_timeout:g}: must be positive")
    if seed < 0:
        raise UsageError(f"--seed {seed}: must not be negative")
    host, port = parse_address("--serve", serve)
    if clock == "sync" and "udp_multicast" in (bus.interface, bus.bench_interface):
        raise UsageError("--clock sync over udp_multicast: refused, datagrams get lost and lockstep would stand still")
    settings = parse_settings("--truth", truth or [])
    try:
        bench = make_bench(nominal, settings, Clock[clock.upper()], seed)
    except TruthError as error:
        raise UsageError(str(error)) from None
    stop = StopRequest(seconds, with_parent)
    try:
        hub = Hub(host, port, (ROBOT_BUS, BENCH_BUS), allow_remote=allow_remote)
    except EmulatorError as error:
        raise BusError(str(error)) from None
    recorder = None
    ports: dict[str, list[BusPort]] = {ROBOT_BUS: [], BENCH_BUS: []}
    try:
        for name, opened in ((ROBOT_BUS, bus.open_robot()), (BENCH_BUS, bus.open_bench())):
            if opened is not None:
                ports[name].append(opened)
        if output.out is not None:
            recorder = _start_recording(output.out, nominal, clock, seed, settings)
        _announce(hub, ports)
        if allow_remote:
            print(f"canarm: anyone who reaches {hub.address[0]}:{hub.address[1]} can drive the robot", file=sys.stderr)
        runner = EmulatorRunner(bench, hub, ports, recorder, sync_timeout, stop.is_due, _tell)
        runner.run()
    except EmulatorError as error:
        raise BusError(str(error)) from None
    finally:
        if recorder is not None:
            recorder.close()
        for group in ports.values():
            for opened in group:
                opened.close()
        hub.close()
    summary = _summary(bench, runner)
    if output.out is not None:
        update_run_file(output.out, "emulator_summary", summary)
    if output.json:
        print(json.dumps(summary), flush=True)
    return 0


def _start_recording(folder: Path, cell: Cell, clock: str, seed: int, truth: dict[str, str]) -> Recorder:
    create_run_folder(folder)
    update_run_file(folder, "cell", cell.model_dump(mode="json"))
    update_run_file(folder, "emulator", {**provenance(), "clock": clock, "seed": seed, "truth": truth})
    return Recorder(folder, cell)


def _announce(hub: Hub, ports: dict[str, list[BusPort]]) -> None:
    host, port = hub.address
    for bus in (ROBOT_BUS, BENCH_BUS):
        print(f"{bus:<6} -i canarm -c {bus} --bus-kwargs host={host} port={port}", flush=True)
        for opened in ports[bus]:
            print(f"{bus:<6} {opened.description}", flush=True)


def _tell(text: str) -> None:
    print(f"canarm: {text}", file=sys.stderr, flush=True)


def _summary(bench: Bench, runner: EmulatorRunner) -> dict[str, object]:
    steps = bench.world.saturated_steps
    return {
        "cycles": bench.cycle + 1,
        "virtual_s": bench.time_ns / 1e9,
        "ignored_frames": bench.ignored_frames,
        "overruns": bench.overruns,
        "stalls": runner.stalls,
        "run_ons": runner.run_ons,
        "current_limited_steps": {
            name: {"d669": limited.d669, "supply": limited.supply}
            for name, limited in zip(bench.cell.joint_names, steps, strict=True)
        },
    }
