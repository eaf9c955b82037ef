"""`canarm controller`: the controller's side as a process of its own."""

import contextlib
import json
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from canarm_controller.errors import ClockMismatchError, ControllerError, InterruptedRunError
from canarm_controller.run.controller import Controller
from canarm_controller.run.recording import SIGNALS_FILE, ControllerRecorder
from canarm_controller.run.runner import LISTEN_NS, Runner, RunResult
from canarm_controller.run.state import State
from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock
from canarm_protocol.errors import BusError, BusOptionsError
from canarm_protocol.runs.out_folder import OutFolder
from canarm_protocol.runs.run_folder import (
    CONTROLLER_FILES,
    SIGNALS_FOLDER,
    SUMMARY,
    RunFolderError,
    create_run_folder,
    update_run_file,
)
from canarm_protocol.runs.tentative import Tentative
from canarm_protocol.transport.realtime import ask_for_realtime

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
    ControlOptions,
    Flag,
    MoreBusWords,
    NamedBus,
    Pace,
    Seconds,
    SyncTimeout,
    WallClockOptions,
    WithParent,
    check_clock,
    check_pace,
    pace_text,
    parse_address,
)
from ..output_options import OutputOptions
from ..provenance import provenance
from ..recording import Recording, parse_recording, recording_failure
from ..session import make_controller, tick_count, traffic_warning
from ..stdout import keep_stdout
from ..stopping import StopRequest, parents_words
from ..summary import Summary, detections_as_plain
from ..usage import UsageError


def controller(
    *bus_options: MoreBusWords,
    cell: CellOptions = CellOptions(),
    control: ControlOptions = ControlOptions(),
    connect: Annotated[
        Address, Parameter(help="Where an emulator serves the virtual buses; used unless -i names another bus.")
    ] = DEFAULT_ADDRESS,
    bus: BusOptions = BusOptions(),
    bench: BenchBusOptions = BenchBusOptions(),
    output: OutputOptions = OutputOptions(),
    clock: ClockName = "wall",
    seconds: Annotated[
        Seconds | None,
        Parameter(show_default=False, help="Length of the run in robot time; unlimited unless given."),
    ] = None,
    pace: Pace = math.inf,
    sync_timeout: SyncTimeout = DEFAULT_SYNC_TIMEOUT_S,
    wall: WallClockOptions = WallClockOptions(),
    progress: Annotated[Flag, Parameter(help="Report the state of the run on stderr.")] = False,
    with_parent: WithParent = False,
) -> int:
    """Control the robot: find the cards, run the law, stop safely.

    Without --seconds, Ctrl-C ends the run as planned (status 0); with it, Ctrl-C is a safe stop (status 1).
    """
    words = parents_words(with_parent)
    place = None if output.out is None else OutFolder.at(output.out)
    tell = _tell if place is None else lambda text: _tell(place.said(text))
    nominal = cell.load()
    robot_bus, bench_bus = bus.named(bus_options), bench.named()
    check_clock(clock, robot_bus, bench_bus)
    wall.check(clock, nominal)
    check_pace(clock, pace)
    ticks = None if seconds is None else tick_count(nominal, seconds)
    host, port = parse_address("--connect", connect)
    if robot_bus is None:
        robot_bus = NamedBus("canarm", ROBOT_BUS, {"host": host, "port": port})
        bench_bus = bench_bus or NamedBus("canarm", BENCH_BUS, {"host": host, "port": port})
    recording = parse_recording(output.record, output.rotate, output.out, tell, with_frames=False)
    say = keep_stdout()
    built = make_controller(
        nominal, control.law, control.motion(nominal), control.feedforward, Clock[clock.upper()], ticks, LISTEN_NS
    )
    warning = None if with_parent else traffic_warning(nominal, cell.cell)
    if warning is not None:
        _tell(warning)
    is_watched = math.isfinite(sync_timeout)
    stop = StopRequest(None, with_parent, _place_of(built) if is_watched else None, words, sync_timeout)
    made = Tentative()
    if place is not None:
        _make_folder(place, made)
    if wall.realtime:
        for refused in ask_for_realtime():
            _tell(f"--realtime: {refused}")
    follower = _Follower(built, ticks, progress, stop)
    given = {
        "cell": nominal.model_dump(mode="json"),
        "law": control.law,
        "trajectory": control.motion(nominal),
        "feedforward": built.loop.feedforward_kind,
        "clock": clock,
        "seconds": seconds,
        **({} if clock == "wall" else {"pace": pace_text(pace)}),
    }

    def on_open() -> None:
        if place is not None:
            follower.recorder = _start_recording(place, built, given, made, recording)

    def last_words(result: RunResult) -> list[str]:
        out = None if place is None or follower.recorder is None else place.path.absolute()
        return _summary(nominal, control, clock, built, result, out).verdict_first()

    pacing = {"spin_ns": wall.spin * 1000, "pace": pace, "answer_s": sync_timeout}
    with made:
        result = _run(built, follower, robot_bus, bench_bus, on_open, pacing, last_words)
    stop.is_over()
    is_told = isinstance(built.error, InterruptedRunError) or follower.recorder is not None
    if isinstance(built.error, ClockMismatchError) or not is_told:
        _forget_recording(place, follower, made)
        is_told = False
    out = place if is_told else None
    summary = _summary(nominal, control, clock, built, result, None if out is None else out.given)
    is_recorded = out is None or _end_recording(out, follower.recorder, summary, result)
    recording.close()
    if not is_recorded:
        summary = replace(summary, broke_off=True)
    if result.ticks and not output.json:
        say(summary.as_text())
    elif result.reason:
        _tell(result.reason)
    if result.note:
        _tell(result.note)
    if output.json:
        say(json.dumps(summary.as_json()))
    if isinstance(built.error, ClockMismatchError):
        return 2
    return 0 if result.state is State.DONE and is_recorded else 1


class _Follower:
    """Follows a run: progress on stderr, events into the run folder, Ctrl-C."""

    def __init__(
        self,
        controller: Controller,
        ticks: int | None,
        progress: bool,
        stop: StopRequest,
    ) -> None:
        self.recorder: ControllerRecorder | None = None
        """Takes the events once the buses are open."""
        self._controller, self._ticks = controller, ticks
        self._progress, self.stop = progress, stop
        self._period_s = controller.loop.period_s
        self._next_s = 1.0

    def on_state(self, state: State) -> None:
        """Take a change of state."""
        if self.recorder is not None:
            self.recorder.state(state)
        if state in (State.DONE, State.FAILED):
            self.stop.is_over()
        if self._progress:
            _tell(state.name.lower().replace("_", " "))

    def should_stop(self) -> str | None:
        """The reason to stop safely now, or None."""
        if self._progress and self._controller.controlled_ticks * self._period_s >= self._next_s:
            approach_s = self._controller.loop.trajectory.approach_s
            total = "" if self._ticks is None else f" of {self._ticks * self._period_s + approach_s:g}"
            _tell(f"{self._next_s:g}{total} s, {self._controller.missed} cycles missed")
            self._next_s += 1.0
        reason = self.stop.reason()
        if reason is not None and self._ticks is None and self._controller.state is State.RUNNING:
            self._controller.end()
            return None
        return reason


def _run(
    controller: Controller,
    follower: _Follower,
    robot_bus: NamedBus,
    bench_bus: NamedBus | None,
    on_open: Callable[[], None],
    pacing: Mapping[str, Any],
    last_words: Callable[[RunResult], Sequence[str]],
) -> RunResult:
    """Open the buses and run; a bus that cannot be opened is a failed run, without `on_open`.

    Raises `BusOptionsError` for options that a driver does not take.
    """
    with contextlib.ExitStack() as stack:
        try:
            with follower.stop.interrupting():
                port = stack.enter_context(robot_bus.open())
                bench = None if bench_bus is None else stack.enter_context(bench_bus.open())
        except BusOptionsError:
            raise
        except (BusError, KeyboardInterrupt) as error:
            lost = ControllerError(str(error))
            if isinstance(error, KeyboardInterrupt):
                lost = InterruptedRunError(f"interrupted: {follower.stop.reason()}, while the bus was opened")
            controller.lose(lost)
            follower.on_state(controller.state)
            return RunResult(controller.state, controller.reason, 0, 0, 0, 0.0, None)
        on_open()
        runner = Runner(controller, port, bench, follower.on_state, follower.should_stop, **pacing)
        result = runner.run()
        runner.tell_outcome(last_words(result))
        return result


def _place_of(built: Controller) -> Callable[[], str]:
    """Tells how far a controller has come that does not go on."""
    return lambda: f"the controller sent nothing after {'its start' if built.tick < 0 else f'cycle {built.tick}'}"


def _make_folder(place: OutFolder, made: Tentative) -> None:
    """Make the run folder; an emulator's run in it is shared, another controller's is refused."""
    if (place.path / SIGNALS_FOLDER / SIGNALS_FILE).exists():
        raise UsageError(f"--out {place.given}: holds a controller's run already; name another folder, or remove it")
    with place.named():
        create_run_folder(place.path, reuse=True, made=made)


def _start_recording(
    place: OutFolder, controller: Controller, given: Mapping[str, Any], made: Tentative, recording: Recording
) -> ControllerRecorder:
    """A recorder. A run that found no bus leaves no files: an emulator may record into the folder later."""
    for name in CONTROLLER_FILES:
        made.file(place.path / name)

    def complain(text: str) -> None:
        _tell(place.said(text))

    with place.named():
        recorder = ControllerRecorder(place.path, controller, complain, time.perf_counter_ns, recording.signals)
        update_run_file(place.path, "controller", {**provenance(), **given})
    controller.on_tick = recorder.tick
    return recorder


def _forget_recording(place: OutFolder | None, follower: "_Follower", made: Tentative) -> None:
    """A run that has found no bus, or is refused by the cards, leaves nothing; an emulator's files stay."""
    if follower.recorder is not None and place is not None:
        follower.recorder.close()
        follower.recorder = None
        with contextlib.suppress(OSError, RunFolderError):
            update_run_file(place.path, "controller", None)
    made.take_back()


def _end_recording(place: OutFolder, recorder: ControllerRecorder | None, summary: Summary, result: RunResult) -> bool:
    """Close the files and add the summary; False, and a line on stderr, if they cannot be written."""
    folder = place.path
    steps = [lambda: update_run_file(folder, SUMMARY, summary.as_json())]
    if result.pacing is not None:
        pacing = result.pacing.summary()
        steps.append(lambda: update_run_file(folder, "pacing", pacing))
    if recorder is not None:
        recorder.close()
    failures = dict.fromkeys(filter(None, [recording_failure(folder, step) for step in steps]))
    for text in failures:
        _tell(place.said(text))
    return not failures and (recorder is None or recorder.failure is None)


def _tell(text: str) -> None:
    print(f"canarm: {text}", file=sys.stderr, flush=True)


def _summary(
    cell: Cell,
    control: ControlOptions,
    clock: str,
    controller: Controller,
    result: RunResult,
    out: Path | None,
) -> Summary:
    state = result.state.name.lower()
    by_verdict = controller.verdict is not None and controller.verdict.detector == "interrupted"
    if by_verdict or isinstance(controller.error, InterruptedRunError):
        state = "interrupted"
    return Summary(
        cell=cell.name,
        law=control.law,
        trajectory=control.motion(cell),
        feedforward=controller.loop.feedforward_kind,
        clock=clock,
        seed=None,
        state=state,
        reason=result.reason,
        ticks=result.ticks,
        missed=result.missed,
        late=result.late,
        starved=result.starved,
        approach_s=controller.loop.trajectory.approach_s,
        real_time_factor=result.real_time_factor if result.ticks else None,
        joints=result.joints,
        out=None if out is None else str(out),
        detections=detections_as_plain(controller.detections),
    )
