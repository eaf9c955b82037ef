"""The emulator alone, for any program as controller: started on its own port, watched on its bus.

Nothing is known of the controller's inside; what it does shows on the bus and in the bench's view of the
robot.
"""

import contextlib
import os
import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID, NmtState
from canarm_protocol.cell.bench_objects import TRUE_ANGLE, TRUE_COMMAND, TRUE_SPEED, sdo_channel
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.faults.bench_client import BenchClient
from canarm_protocol.faults.fault_events import FaultEvent
from canarm_protocol.faults.fault_toml import as_toml
from canarm_protocol.faults.script import FaultScript
from canarm_protocol.transport.port import BusPort, open_port
from canarm_protocol.transport.sdo_session import SdoSession

from ..child import Child, offered_port
from ..rig.bus_rig import BENCH_BUS, HOST
from ..rig.findings import begun_of
from ..rig.recorded import RecordedHistory, fault_events, read_events, recorded_joints
from ..rig.rig_faults import FaultControl, FaultSource, plainly
from ..rig.rig_joint import UnknownJoint
from ..rig.run_plot import plot_run
from ..session import DEFAULT_CELL
from ..usage import UsageError
from .keeping import fault_complaints, fault_lines
from .program import Program, check_limit
from .watch import BusWatch, SeenEmergency, SeenFrame, SeenNmt

ANSWER_S = 10.0
"""How long the bench may take to answer; the machine may be busy."""
WAIT_S = 10.0
AFTER_END_S = 1.0
"""Bus time, longer than any heartbeat time-out, so that the cards have had time to notice."""
QUIET_S = 1.0
"""Wall time without a frame."""


class CanarmBench(FaultControl):
    """The fixture `canarm_bench`. The emulator starts with `start`, or with the first use of anything else.

    `port` is where to attach: socketcand protocol, or python-can's `interface="canarm", host="127.0.0.1", port=…`.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        super().__init__()
        self.folder, self._seed = folder, seed
        self.cell: Cell = load_cell(DEFAULT_CELL)
        self.controller: Program | None = None
        """The program started last."""
        self._programs: list[Program] = []
        self._emulator: Child | None = None
        self._port = 0
        self._watch: BusWatch | None = None

    def start(
        self,
        cell: str | Path = DEFAULT_CELL,
        *,
        clock: str = "sync",
        seed: int | None = None,
        wire: bool = False,
        truth: Mapping[str, object] | None = None,
        faults: FaultSource | None = None,
        sync_timeout: float = 10.0,
    ) -> Self:
        """Start the emulator; arguments as on the command line, `seed` --canarm-seed unless given.

        In lockstep, time runs on by itself once SYNC has been missing for `sync_timeout` s of wall time, or its sender
        has left. Raises `UsageError` for bad arguments, or if it runs already; `BusError` if it does not start.
        """
        if self._emulator is not None:
            raise UsageError("start: the emulator runs already; call start() before anything else")
        self.cell = load_cell(str(cell))
        words = ["--cell", str(cell), "--serve", f"{HOST}:0", "--clock", clock, "--sync-timeout", str(sync_timeout)]
        words += ["--seed", str(self._seed if seed is None else seed), "--out", str(self.folder)]
        words += [word for key, value in (truth or {}).items() for word in ("--truth", f"{key}={value}")]
        self._emulator = Child("emulator", [*words, *(["--wire"] * wire)], quiet=True)
        self._port = offered_port(self._emulator)
        self._watch = BusWatch(open_port("canarm", "can0", host=HOST, port=self._port))
        if faults is not None:
            self.inject_file(faults)
        return self

    @property
    def host(self) -> str:
        """Where the emulator serves its buses."""
        return HOST

    @property
    def port(self) -> int:
        """The port on which the emulator serves its buses."""
        self._listener()
        return self._port

    def start_controller(
        self,
        command: str | Sequence[str | os.PathLike[str]],
        *,
        cwd: Path | None = None,
        env: Mapping[str, str] | None = None,
    ) -> Program:
        """Start the controller under test, which should attach to `port`; it ends with the test.

        `command` is a list of words, or a string that is split as by a shell; {host} and {port} in it are replaced.
        Raises `UsageError` if it cannot be started.
        """
        __tracebackhide__ = True
        self._listener()
        log = self.folder / f"controller-{len(self._programs) + 1}.txt"
        places = {"{host}": HOST, "{port}": str(self._port)}
        self.controller = plainly(lambda: Program(command, log, cwd, env, places))
        self._programs.append(self.controller)
        return self.controller

    def wait_for(
        self,
        condition: Callable[[], object],
        timeout: float = WAIT_S,
        what: str | None = None,
        *,
        after_exit: bool = False,
    ) -> None:
        """Wait until `condition()` is true. Raises `AssertionError` after `timeout` s of wall time.

        It is raised as well when the controllers have ended by themselves, and the condition is still false
        `AFTER_END_S` of the bus's time later, or when nothing is heard for `QUIET_S`: what they were to do, they will
        not do. Unless `after_exit`: then what happens after their end is waited for. That is understood where the test
        has ended a controller, by `kill`, `interrupt` or `wait`. Raises `UsageError` for a `timeout` that never comes.
        """
        __tracebackhide__ = True
        check_limit(timeout, "wait_for: timeout")
        watch, end = self._listener(), _AfterEnd()

        def is_decided() -> bool:
            if condition():
                return True
            left = not after_exit and any(each.has_left for each in self._programs)
            is_over = left and all(each.status is not None for each in self._programs)
            return is_over and end.is_over(time.monotonic(), watch.time_s)

        is_in_time = watch.wait_for(is_decided, timeout)
        if is_in_time and not end.has_come:
            return
        what = what or getattr(condition, "__name__", "the condition")
        why = f"not within {timeout:g} s: {what}"
        if end.has_come and self.controller is not None:
            why = f"the controller has ended with status {self.controller.status}, before: {what}"
        raise AssertionError(f"{why}; {self.story()}")

    @property
    def frames(self) -> list[SeenFrame]:
        """The last 100 000 frames on the robot's bus, with their times."""
        return list(self._listener().frames)

    @property
    def nmt_commands(self) -> list[SeenNmt]:
        """NMT commands so far; oldest first."""
        return list(self._listener().nmt)

    @property
    def emergencies(self) -> list[SeenEmergency]:
        """Emergencies (EMCY) so far; oldest first. Code 0 is an error reset."""
        return list(self._listener().emergencies)

    @property
    def time_s(self) -> float:
        """Bus time: that of the last frame."""
        return self._listener().time_s

    def heartbeat_state(self, node: int) -> NmtState | None:
        """The state in a node's last heartbeat; None if there was none.

        The node need not be the cell's: the controller is yours. Raises `UsageError` for an impossible node-ID.
        """
        __tracebackhide__ = True
        seen = self._heartbeat(node)
        return None if seen is None else seen[1]

    def heartbeat_age_s(self, node: int) -> float | None:
        """Bus time since a node's last heartbeat; None if there was none. Errors as `heartbeat_state`."""
        __tracebackhide__ = True
        seen = self._heartbeat(node)
        return None if seen is None else self.time_s - seen[0]

    def outputs_are_zero(self) -> bool:
        """Whether truly no amplifier is commanded any current: magnitude or direction is zero."""
        return not any(self._read(TRUE_COMMAND))

    def true_angle_rad(self, joint: str) -> float:
        """The true angle of a joint. Raises `UnknownJoint`, a `UsageError`."""
        __tracebackhide__ = True
        return self._read_of(joint, TRUE_ANGLE)

    def true_speed_rad_s(self, joint: str) -> float:
        """The true speed of a joint. Raises `UnknownJoint`, a `UsageError`."""
        __tracebackhide__ = True
        return self._read_of(joint, TRUE_SPEED)

    def end(self) -> None:
        """End the controllers, then the emulator. May be called again."""
        for program in self._programs:
            program.end()
        if self._watch is not None:
            self._watch.close()
        if self._emulator is not None:
            self._emulator.end()

    def plot(self, title: str) -> str:
        """The true motion of its joints."""
        joints = recorded_joints(self.cell, RecordedHistory(self.cell, self.folder, {}))
        return plot_run(title, joints, begun_of(self._fault_events()))

    def story(self) -> str:
        """The controllers, and their reactions as seen on the bus."""
        watch = self._watch
        if watch is None:
            return "the emulator was not started"
        lost = [f"bus lost: {watch.lost}"] if watch.lost else []
        seen = [(each.time_s, f"NMT {each.command.name} to {_node_name(each.node_id)}") for each in watch.nmt]
        seen += [(each.time_s, f"EMCY 0x{each.code:04X} of {_node_name(each.node_id)}") for each in watch.emergencies]
        seen += fault_lines(self._fault_events())
        lines = [f"{time_s:9.4f} s  {text}" for time_s, text in sorted(seen, key=lambda each: each[0])]
        states = [f"{_node_name(node)} {state.name}" for node, (_, state) in sorted(watch.heartbeats.items())]
        last = f"{watch.time_s:9.4f} s  last frame; heartbeats: {', '.join(states) or 'none'}"
        return "\n".join([*map(repr, self._programs), *lost, *lines, last])

    @property
    def label(self) -> str:
        """A label that tells it from rigs of the same test."""
        return "canarm_bench"

    @property
    def never_begun(self) -> list[str]:
        """Sets that were injected and not cleared, but have not begun."""
        begun = {each.set_name for each in self._fault_events() if each.is_begin}
        return [name for name in self._awaited if name not in begun]

    def complaints(self) -> list[str]:
        """Faults that never began, or were themselves faulty."""
        return fault_complaints(self.never_begun, self._fault_events()) if self._awaited else []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    def _accept(self, script: FaultScript) -> None:
        with self._client() as (_, client):
            client.inject(as_toml(script))

    def _fault_events(self) -> list[FaultEvent]:
        return fault_events(read_events(self.folder))

    def _listener(self) -> BusWatch:
        if self._watch is None:
            self.start()
        assert self._watch is not None
        return self._watch

    def _heartbeat(self, node: int) -> tuple[float, NmtState] | None:
        __tracebackhide__ = True
        if node not in range(1, HIGHEST_NODE_ID + 1):
            ours = ", ".join(f"0x{card.node_id:02X} ({card.name})" for card in self.cell.card)
            raise UsageError(
                f"heartbeat of node {node!r}: node-IDs are 0x01 to 0x{HIGHEST_NODE_ID:02X}; "
                f"cards of the cell are {ours}"
            )
        return self._listener().heartbeats.get(node)

    @contextlib.contextmanager
    def _client(self) -> Iterator[tuple[BusPort, BenchClient]]:
        """The bench bus, opened for each use: on an unread one, a controller's reports would pile up."""
        with (
            open_port("canarm", BENCH_BUS, host=HOST, port=self.port) as port,
            BenchClient(port, self.cell, ANSWER_S) as client,
        ):
            yield port, client

    def _read_of(self, joint: str, index: int) -> float:
        __tracebackhide__ = True
        names = self.cell.joint_names
        if joint not in names:
            raise UnknownJoint(joint, names)
        return self._read(index)[names.index(joint)]

    def _read(self, index: int) -> list[float]:
        """Read an object of the bench node that has a number per joint."""
        with self._client() as (port, client):
            session = SdoSession(port, *sdo_channel(self.cell.bus.bench_node_id, client.channel), limit_s=ANSWER_S)
            joints = range(1, len(self.cell.joints) + 1)
            return [float(struct.unpack("<f", session.upload(index, joint))[0]) for joint in joints]


class _AfterEnd:
    """How long effects of the controllers may still show after their end."""

    def __init__(self) -> None:
        self.has_come = False
        self._end_s: float | None = None
        self._heard: tuple[float, float] = (0.0, 0.0)
        """Bus time and wall time of the last frame."""

    def is_over(self, wall_s: float, bus_s: float) -> bool:
        if self._end_s is None:
            self._end_s, self._heard = bus_s, (bus_s, wall_s)
        if bus_s != self._heard[0]:
            self._heard = bus_s, wall_s
        self.has_come = bus_s - self._end_s > AFTER_END_S or wall_s - self._heard[1] > QUIET_S
        return self.has_come


def _node_name(node_id: int) -> str:
    return f"node 0x{node_id:02X}" if node_id else "all nodes"
