"""`canarm emulator`: the robot's side as a process of its own."""

import contextlib
import json
import math
import os
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.serving.hub import Hub
from canarm_emulator.serving.recording import Recorder
from canarm_emulator.serving.runner import EmulatorRunner
from canarm_emulator.serving.session_recording import SessionRecorder
from canarm_emulator.serving.slcan_port import SOCKET_URL, SlcanPort, SlcanSocket
from canarm_emulator.serving.slcan_terminal import SlcanTerminal
from canarm_emulator.wire.bus_trouble import BusTrouble
from canarm_emulator.wire.wire import Wire as WireModel
from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock
from canarm_protocol.faults.fault_toml import as_toml
from canarm_protocol.runs.out_folder import OutFolder
from canarm_protocol.runs.run_events import runs_of
from canarm_protocol.runs.run_folder import claim_run_folder, update_run_file
from canarm_protocol.runs.tentative import Tentative
from canarm_protocol.transport.port import BusPort

from ..fault_file import load_faults
from ..options import (
    BENCH_BUS,
    DEFAULT_ADDRESS,
    DEFAULT_SYNC_TIMEOUT_S,
    ROBOT_BUS,
    Address,
    BenchBusOptions,
    BusOptions,
    CellOptions,
    ClockName,
    FaultFile,
    Flag,
    MoreBusWords,
    Seconds,
    Seed,
    SyncTimeout,
    Truth,
    Wire,
    WithParent,
    check_clock,
    parse_address,
)
from ..output_options import OutputOptions
from ..provenance import provenance
from ..recording import Recording, parse_recording, recording_failure
from ..serving import attach_flags, exposure_lines
from ..session import make_bench, traffic_warning
from ..stopping import StopRequest, parents_words
from ..usage import UsageError, parse_settings

WINDOWS_PORT = re.compile(r"com\d+:?", re.IGNORECASE)


@Parameter(name="*")
@dataclass(frozen=True)
class WorldOptions:
    """The true robot, and what drives its time."""

    clock: ClockName = "wall"
    sync_timeout: SyncTimeout = DEFAULT_SYNC_TIMEOUT_S
    seed: Seed = 0
    truth: Truth = field(default_factory=list)
    wire: Wire = False
    faults: FaultFile = None


def emulator(
    *bus_options: MoreBusWords,
    cell: CellOptions = CellOptions(),
    world: WorldOptions = WorldOptions(),
    serve: Annotated[
        Address, Parameter(help="Where to serve the virtual buses (socketcand protocol); port 0 is any free one.")
    ] = DEFAULT_ADDRESS,
    allow_remote: Annotated[
        Flag,
        Parameter(
            help="Serve other machines too: whoever reaches the port can drive the robot, set faults, read everything."
        ),
    ] = False,
    slcan: Annotated[
        bool | str,
        Parameter(
            negative=(),
            metavar="[PATH|socket://HOST:PORT]",
            show_default=False,
            help="Offer the robot's bus as a serial CAN adapter too, on a pseudo-terminal that PATH will link to, "
            "or on a TCP port.",
        ),
    ] = False,
    bus: BusOptions = BusOptions(),
    bench_bus: BenchBusOptions = BenchBusOptions(),
    output: OutputOptions = OutputOptions(),
    seconds: Annotated[
        Seconds | None, Parameter(show_default=False, help="End after so much wall time; unlimited unless given.")
    ] = None,
    with_parent: WithParent = False,
) -> int:
    """Emulate the robot: cards, electrics, arm and both buses.

    Prints how to attach to each bus with python-can's flags. Ends on Ctrl-C, which is status 0.
    """
    words = parents_words(with_parent)
    place = None if output.out is None else OutFolder.at(output.out)
    tell = _tell if place is None else lambda text: _tell(place.said(text))
    nominal = cell.load()
    buses = {ROBOT_BUS: bus.named(bus_options), BENCH_BUS: bench_bus.named()}
    if allow_remote:
        buses = {name: None if named is None else named.allowing_remote() for name, named in buses.items()}
    check_clock(world.clock, *buses.values())
    host, port = parse_address("--serve", serve, any_port=True)
    settings = parse_settings("--truth", world.truth)
    bench = make_bench(nominal, settings, Clock[world.clock.upper()], world.seed, world.wire)
    script = None if world.faults is None else load_faults(world.faults, bench)
    stop = StopRequest(seconds, with_parent, parents_words=words)
    with contextlib.ExitStack() as stack:
        made = stack.enter_context(Tentative())
        hub = stack.enter_context(contextlib.closing(_serve(host, port, allow_remote)))
        ports = {name: [] if named is None else [stack.enter_context(named.open())] for name, named in buses.items()}
        adapter = stack.enter_context(_offer_slcan(slcan, allow_remote)) if slcan is not False else None
        if adapter is not None:
            ports[ROBOT_BUS].append(adapter)
        recorder = None
        recording = parse_recording(output.record, output.rotate, output.out, tell)
        stack.callback(recording.close)
        if place is not None:
            given = {
                "clock": world.clock,
                "seed": world.seed,
                "truth": settings,
                "wire": world.wire,
                "sync_timeout_s": world.sync_timeout if math.isfinite(world.sync_timeout) else None,
                "faults": None if script is None else as_toml(script),
            }
            recorder = _start_recording(place, nominal, given, made, recording)
            stack.callback(recorder.close)
        remote = adapter.address if isinstance(adapter, SlcanSocket) else None
        for line in exposure_lines(hub.address, remote, buses):
            _tell(line)
        warning = traffic_warning(nominal, cell.cell) if world.wire and not with_parent else None
        if warning is not None:
            _tell(warning)

        def announce() -> None:
            made.keep()
            _announce(hub, ports)

        runner = EmulatorRunner(bench, hub, ports, recorder, world.sync_timeout, stop.is_due, _tell, script, announce)
        failure = _run(runner, recorder)
        summary = {
            "cell": nominal.name,
            "clock": world.clock,
            "seed": world.seed,
            "state": "done" if failure is None else "failed",
            "reason": failure,
            "faults_never_begun": [] if script is None else bench.faults.never_begun,
            **_figures(bench, runner),
            "malformed_commands": hub.malformed + (0 if adapter is None else adapter.refused),
            "malformed_frames": sum(port.discarded.malformed for group in ports.values() for port in group),
            "foreign_frames": sum(port.discarded.foreign for group in ports.values() for port in group),
            "dropped_frames": sum(hub.dropped.values()) + (0 if adapter is None else adapter.dropped),
            "out": None if output.out is None else str(output.out),
        }
        if place is not None:
            folder = place.path
            unwritten = recording_failure(folder, lambda: update_run_file(folder, "emulator_summary", summary))
            recording.close()
            if recording.at_the_end:
                from ..runs.converting import convert_all  # brings half of canarm

                for run in runs_of(folder):
                    if not convert_all(run, recording.at_the_end, tell):
                        unwritten = unwritten or f"{run}: not in all formats that --record names"
            failure = failure or unwritten
            failure = None if failure is None else place.said(failure)
    if output.json:
        print(json.dumps(summary), flush=True)
    elif "wire" in summary:
        _tell(_wire_text(summary["wire"]))
    if failure is not None:
        _tell(failure)
    return 0 if failure is None else 1


def _run(runner: EmulatorRunner, recorder: Recorder | None) -> str | None:
    """Serve until the end. If the run is not recorded whole (a full disk, for example), returns why."""
    runner.run()
    if recorder is None:
        return None
    recorder.close()
    return recorder.failure


def _serve(host: str, port: int, allow_remote: bool) -> Hub:
    return Hub(host, port, (ROBOT_BUS, BENCH_BUS), allow_remote=allow_remote)


def _offer_slcan(where: bool | str, allow_remote: bool) -> SlcanPort:
    """An adapter at a path or `socket://HOST:PORT`; with `True`, a pseudo-terminal with the default name."""
    if where == "":
        raise UsageError("--slcan: the path is empty; give one, or --slcan alone for the usual name")
    if isinstance(where, str) and where.startswith(SOCKET_URL):
        host, port = parse_address("--slcan", where, any_port=True, scheme=SOCKET_URL)
        return SlcanSocket(host, port, allow_remote=allow_remote)
    if isinstance(where, str) and os.name == "posix" and WINDOWS_PORT.fullmatch(where):
        raise UsageError(
            f"--slcan {where}: that is a serial port of Windows; this is the PATH of a link to a pseudo-terminal, "
            f"such as /tmp/{where} (a serial adapter that is there already: -i slcan -c PORT)"
        )
    return SlcanTerminal(Path(where) if isinstance(where, str) else None)


def _start_recording(
    place: OutFolder, cell: Cell, given: Mapping[str, Any], made: Tentative, recording: Recording
) -> Recorder:
    with place.named():
        claim_run_folder(place.path, made)

    def complain(text: str) -> None:
        _tell(place.said(text))

    def describe(folder: Path) -> None:
        update_run_file(folder, "cell", cell.model_dump(mode="json"))
        update_run_file(folder, "emulator", {**provenance(), **given})

    with place.named():
        recorder = SessionRecorder(
            place.path, cell, complain, describe, recording.frames, recording.signals, with_bench=recording.with_bench
        )
        describe(place.path)
    return recorder


def _announce(hub: Hub, ports: Mapping[str, Sequence[BusPort]]) -> None:
    """Print how to attach, in one write: a reader that leaves after the first line must not end the emulator."""
    lines = []
    for bus in (ROBOT_BUS, BENCH_BUS):
        lines.append(f"{bus:<6} {attach_flags(bus, *hub.address)}")
        lines += [f"{bus:<6} {opened.description}" for opened in ports[bus]]
    print("\n".join([*lines, ""]), end="", flush=True)


def _tell(text: str) -> None:
    print(f"canarm: {text}", file=sys.stderr, flush=True)


def _wire_figures(wire: WireModel, trouble: BusTrouble) -> dict[str, Any]:
    """Share of the emulator's life, and of its busiest second, that the bus was busy; the longest that a frame of each
    identifier had to wait and travel; errors; frames lost in bus-off or beyond a node's queue.
    """
    worst = {f"0x{can_id:03X}": round(ns / 1000, 1) for (can_id, _), ns in sorted(wire.worst_response_ns.items())}
    return {
        "load": round(wire.load(), 4),
        "peak_load_1s": round(wire.peak_load, 4),
        "worst_response_us": worst,
        "error_frames": trouble.error_frames,
        "lost_frames": trouble.lost_frames,
    }


def _wire_text(figures: Mapping[str, Any]) -> str:
    worst: Mapping[str, float] = figures["worst_response_us"]
    slowest = max(worst, key=lambda name: worst[name], default=None)
    response = "no frame" if slowest is None else f"worst response {worst[slowest]:g} us ({slowest})"
    return (
        f"wire: load {figures['load']:.1%} since start, {figures['peak_load_1s']:.1%} in the busiest second; "
        f"{response}; {figures['error_frames']} error frames, {figures['lost_frames']} frames lost"
    )


def _figures(bench: FaultBench, runner: EmulatorRunner) -> dict[str, Any]:
    """Figures of the whole session, except `cycles`: SYNCs since the last NMT start."""
    steps = bench.world.saturated_steps
    return {
        "cycles": bench.cycle + 1,
        "virtual_s": bench.time_ns / 1e9,
        "ignored_frames": bench.ignored_frames,
        "overruns": bench.overruns,
        "stalls": runner.stalls,
        "run_ons": runner.run_ons,
        "faults": bench.device.faults.begun,
        "emergency_stop_cycle": runner.emergency_stop_cycle,
        **({} if bench.cell.object is None else {"object": bench.world.object_summary()}),
        **({"sync_arrival": runner.sync_intervals.summary()} if bench.clock is Clock.WALL else {}),
        **({} if bench.wire is None else {"wire": _wire_figures(bench.wire, bench.trouble)}),
        "current_limited_steps": {
            name: {"drive": limited.own, "supply": limited.supply}
            for name, limited in zip(bench.cell.joint_names, steps, strict=True)
        },
        "refused_directions": dict(zip(bench.cell.joint_names, bench.world.illegal_directions, strict=True)),
    }
