"""`canarm controller`: the controller's side as a process of its own."""

import json
import sys
from typing import Annotated

from canarm_controller.controller import Controller, State
from canarm_controller.errors import ClockMismatchError, ControllerError
from canarm_controller.recording import ControllerRecorder
from canarm_controller.runner import LISTEN_NS, Runner, RunResult
from canarm_protocol.cell import Cell
from canarm_protocol.clock import Clock
from canarm_protocol.errors import BusError
from canarm_protocol.port import BusPort, open_port
from canarm_protocol.run_folder import create_run_folder, update_run_file
from cyclopts import Parameter

from ..options import DEFAULT_ADDRESS, BusOptions, CellOptions, ClockName, ControlOptions, OutputOptions, parse_address
from ..session import UsageError, make_controller, provenance, tick_count
from ..stopping import StopRequest
from ..summary import JointFigures, Summary


def controller(
    *,
    cell: CellOptions = CellOptions(),
    control: ControlOptions = ControlOptions(),
    bus: BusOptions = BusOptions(),
    output: OutputOptions = OutputOptions(),
    connect: Annotated[
        str, Parameter(help="HOST:PORT of an emulator's virtual bus; used unless -i names another bus.")
    ] = DEFAULT_ADDRESS,
    clock: Annotated[ClockName, Parameter(help="Pace by the wall clock, or by the emulator's TIME (lockstep).")] = "wall",
    seconds: Annotated[float | None, Parameter(help="Length of the run in seconds of robot time; until Ctrl-C unless given.")]
    = None,
    progress: Annotated[bool, Parameter(negative=(), help="Report the state of the run on stderr.")] = False,
    with_parent: Annotated[bool, Parameter(negative=(), show=False)] = False,
) -> int:
    """Control the robot: find the cards, run the law, stop safely.

    Without --seconds, Ctrl-C ends the run as planned; with it, Ctrl-C is a safe stop.
    """
    nominal = cell.load()
    ticks = None if seconds is None else tick_count(nominal, seconds)
    host, port_number = parse_address("--connect", connect)
    try:
        built = make_controller(
            nominal, control.law, control.trajectory, control.feedforward, Clock[clock.upper()], ticks, LISTEN_NS
        )
    except ControllerError as error:
        raise UsageError(str(error)) from None
    stop = StopRequest(None, with_parent)
    port, bench = _open_buses(bus, host, port_number)
    recorder = None
    try:
        if output.out is not None:
            create_run_folder(output.out, reuse=True)
            update_run_file(
                output.out,
                "controller",
                {**provenance(), "law": control.law, "trajectory": control.trajectory, "clock": clock},
            )
            recorder = ControllerRecorder(output.out, built)
            built.on_tick = recorder.tick
        follower = _Follower(built, nominal, ticks, recorder, progress, stop)
        result = Runner(built, port, bench, follower.on_state, follower.should_stop).run()
    finally:
        if recorder is not None:
            recorder.close()
        port.close()
        if bench is not None:
            bench.close()
    summary = _summary(nominal, control, clock, built, result, output)
    if output.out is not None:
        update_run_file(output.out, "summary", summary.as_json())
        if result.lateness is not None:
            update_run_file(output.out, "lateness", result.lateness.summary())
    if not output.json:
        print(summary.as_text(), flush=True)
    elif result.reason:
        print(f"canarm: {result.reason}", file=sys.stderr)
    if result.note:
        print(f"canarm: {result.note}", file=sys.stderr)
    if output.json:
        print(json.dumps(summary.as_json()), flush=True)
    if isinstance(built.error, ClockMismatchError):
        return 2
    return 0 if result.state is State.DONE else 1


class _Follower:
    """Watches a run for its user: progress on stderr, events in the run folder, Ctrl-C."""

    def __init__(
        self,
        controller: Controller,
        cell: Cell,
        ticks: int | None,
        recorder: ControllerRecorder | None,
        progress: bool,
        stop: StopRequest,
    ) -> None:
        self._controller, self._ticks, self._recorder, self._progress, self._stop = (
            controller,
            ticks,
            recorder,
            progress,
            stop,
        )
        self._period_s = cell.bus.cycle_s
        self._next_s = 1.0

    def on_state(self, state: State) -> None:
        """Take a change of state."""
        if self._recorder is not None:
            self._recorder.state(state)
        if self._progress:
            print(f"canarm: {state.name.lower().replace('_', ' ')}", file=sys.stderr, flush=True)

    def should_stop(self) -> str | None:
        """Why to stop safely now, or None."""
        if self._progress and self._controller.controlled_ticks * self._period_s >= self._next_s:
            total = "" if self._ticks is None else f" of {self._ticks * self._period_s:g}"
            missed = self._controller.missed
            print(f"canarm: {self._next_s:g}{total} s, {missed} cycles missed", file=sys.stderr, flush=True)
            self._next_s += 1.0
        reason = self._stop.reason()
        if reason is not None and self._ticks is None and self._controller.state is State.RUNNING:
            self._controller.end()
            return None
        return reason


def _open_buses(bus: BusOptions, host: str, port: int) -> tuple[BusPort, BusPort | None]:
    """The robot's bus, and the bench's where there is one."""
    robot = bus.open_robot()
    is_hub = robot is None
    robot = robot or open_port("canarm", "can0", host=host, port=port)
    try:
        bench = bus.open_bench()
        if bench is None and is_hub:
            bench = open_port("canarm", "bench", host=host, port=port)
    except BusError:
        robot.close()
        raise
    return robot, bench


def _summary(
    cell: Cell,
    control: ControlOptions,
    clock: str,
    controller: Controller,
    result: RunResult,
    output: OutputOptions,
) -> Summary:
    state = result.state.name.lower()
    if controller.verdict is not None and controller.verdict.detector == "interrupted":
        state = "interrupted"
    return Summary(
        cell=cell.name,
        law=control.law,
        trajectory=control.trajectory,
        feedforward=controller.loop.feedforward_kind,
        clock=clock,
        seed=None,
        state=state,
        reason=result.reason,
        ticks=result.ticks,
        missed=result.missed,
        late=result.late,
        real_time_factor=result.real_time_factor,
        joints={
            name: JointFigures(
                figures.rms_lsb,
                figures.max_lsb,
                figures.peak_current_a,
                figures.saturated_cycles,
                figures.speed_ripple,
            )
            for name, figures in result.joints.items()
        },
        out=None if output.out is None else str(output.out),
    )
