"""Drives the emulated bench over real buses: the edge that owns hub, ports, wall clock and files."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from canarm_protocol.canopen.frames import ERROR_FLAG, Cob, Frame, NmtState
from canarm_protocol.cell.bench_objects import DIVIDER
from canarm_protocol.clock import Clock
from canarm_protocol.faults.fault_events import FaultEvent
from canarm_protocol.faults.script import FaultScript
from canarm_protocol.transport.port import BusPort
from canarm_protocol.transport.realtime import Collector, undisturbed

from ..bench.bench import CycleTruth, Record
from ..bench.robot_bus import is_sync
from ..bench_node.bus_figures import ClientCounts
from ..bench_node.fault_objects import event_text
from ..faults.fault_bench import FaultBench
from ..timing import NEVER
from .hub import Hub
from .hub_events import Attached, Detached, Event, Ready, Received, Unreadable
from .recording import Recorder
from .sync_intervals import SyncIntervals

ROBOT_BUS, BENCH_BUS = "can0", "bench"
QUIET_NS = 100_000_000
"""When nothing has come on the robot's bus for so long, the record is written out: somebody may read it now."""
LISTENER_NS = 1_500_000_000
"""Telemetry goes on this long after a listener's last heartbeat."""
IDLE_TELEMETRY_NS = 100_000_000
"""Period of telemetry without SYNC."""
IDLE_S = 0.05
PORT_POLL_S = 0.001
"""Polling interval of a port without a file descriptor."""
STALL_NS = 10_000_000
"""A wait that lasts this much longer than asked for is a stall of the machine, and not the robot's fault."""
LONGEST_REPLAY_NS = 1_000_000_000
"""Longest part of a stall that is caught up; virtual time skips the rest."""
RESTED = "a new controller begins after another"
SHORTEST_FRAME_BITS = 47
"""Bits of a frame without data, with intermission (ISO 11898-1), which bounds the frames that a bus can carry."""


class EmulatorRunner:
    """Ties a bench to its buses.

    `ports` are further buses besides the hub, by bus name ("can0", "bench"). In lockstep a controller counts as lost
    after `sync_timeout_s` of silence, which may be infinite. `should_stop` is called in every round. `faults` are
    injected as soon as the bench has started.
    """

    def __init__(
        self,
        bench: FaultBench,
        hub: Hub,
        ports: Mapping[str, Sequence[BusPort]] | None = None,
        recorder: Recorder | None = None,
        sync_timeout_s: float = 2.0,
        should_stop: Callable[[], bool] = lambda: False,
        on_event: Callable[[str], None] = lambda text: None,
        faults: FaultScript | None = None,
        on_ready: Callable[[], None] = lambda: None,
    ) -> None:
        self._bench, self._hub, self._recorder = bench, hub, recorder
        self._on_ready = on_ready
        ports = ports or {}
        self._ports: dict[str, list[BusPort]] = {bus: list(ports.get(bus, ())) for bus in (ROBOT_BUS, BENCH_BUS)}
        self._bus_of = {id(port): bus for bus, group in self._ports.items() for port in group}
        self._polled = [port for group in self._ports.values() for port in group if port.fileno() is None]
        self._sync_timeout_ns = sync_timeout_s * 1e9
        self._should_stop, self._on_event = should_stop, on_event
        self._script = faults
        self._sync_sender: object = None
        self._last_heard_ns = 0
        self._last_sync_time_ns = 0
        self._origin: object = None
        """Who has sent the frame that is being taken."""
        self._is_behind = False
        self._gap_ns = 0
        self._queued_syncs = 0
        self._listener_until_ns = 0
        self._next_idle_telemetry_ns = 0
        self._stopped: tuple[int | None, int | None] = None, None
        self._sent_cycle = -1
        self._recorded_run = 0
        self._write_out_ns = 0
        self._last_look_ns = time.monotonic_ns()
        self._start_ns = self._last_look_ns
        self.sync_intervals = SyncIntervals(bench.cell.bus.cycle_ns)
        """How regularly SYNC arrives on the wall clock."""
        self.stalls = 0
        """How often the machine kept the emulator from running for longer than `STALL_NS`."""
        self.run_ons = 0
        """How often the sender of SYNC was lost in lockstep."""
        for group in self._ports.values():
            for port in group:
                if port.fileno() is not None:
                    hub.watch(port)  # type: ignore[arg-type]
        if recorder is not None:
            bench.on_cycle = self._record_cycle
            bench.on_script = lambda script: recorder.script(bench.time_ns, script)
            bench.device.run.attach(recorder, self._switch_recording)
        bench.device.buses.count_clients = self._count_clients
        bench.device.faults.on_event = self._fault_event
        bench.device.on_emergency_stop = self._emergency_stop
        bench.device.on_power_cycle = self._powered_on
        bench.on_rested = self._rested

    @property
    def emergency_stop_cycle(self) -> int | None:
        """The cycle of the present run in which the emergency stop was pressed first; None if it was not."""
        run, cycle = self._stopped
        return cycle if run == self._bench.run else None

    def run(self) -> None:
        """Power on, call `on_ready`, and serve until `should_stop`. Raises `BusError` when a port's bus is lost.

        Whoever waits for `on_ready` meets cards that have booted: what is sent then is not lost in their power-on.
        """
        self._bench.device.faults.prepare()
        if self._bench.clock is Clock.SYNC:
            self._serve(None)
        else:
            with undisturbed(time.monotonic_ns) as collector:
                self._serve(collector)

    def _serve(self, collector: Collector | None) -> None:
        bench, lockstep = self._bench, self._bench.clock is Clock.SYNC
        self._start_ns = self._last_look_ns = time.monotonic_ns()
        bench.start()
        self._deliver()
        if self._script is not None:
            bench.inject(self._script)
        self._on_ready()
        while not self._should_stop():
            timeout_s = self._timeout_s()
            events = self._hub.poll(timeout_s)
            now_ns = time.monotonic_ns()
            if not lockstep:
                self._follow_wall_clock(now_ns, timeout_s)
            if self._is_behind:
                self._catch_up(events, now_ns)
            else:
                self._take_all(self._received(events), now_ns)
            if lockstep and self._sync_sender is not None and now_ns - self._last_heard_ns > self._sync_timeout_ns:
                self._run_on(f"no SYNC for {self._sync_timeout_ns / 1e9:g} s")
            self._telemetry(now_ns)
            self._deliver()
            self._write_out(now_ns)
            bench.move_on()
            if collector is not None and not events:
                collector.cycle_done(NEVER)
        self._deliver()

    def _write_out(self, now_ns: int) -> None:
        """Between two runs the files are whole on disk, though the emulator goes on."""
        if self._recorder is not None and now_ns >= self._write_out_ns:
            self._write_out_ns = now_ns + QUIET_NS
            self._recorder.write_out()

    def _received(self, events: Sequence[Event]) -> Iterator[Event]:
        """Input in order: events of clients, frames of clients and ports. A port is read when it is due."""
        for event in events:
            if type(event) is Ready:
                yield from self._read(event.fileobj)  # type: ignore[arg-type]
            else:
                yield event
        for port in self._polled:
            yield from self._read(port)

    def _read(self, port: BusPort) -> Iterator[Received]:
        bus = self._bus_of[id(port)]
        return (Received(bus, port, frame) for _, frame in port.receive(0.0))

    def _take_all(self, received: Iterable[Event], now_ns: int) -> None:
        for each in received:
            if type(each) is Received:
                self._take(*each, now_ns)
            else:
                self._client_event(each)

    def _timeout_s(self) -> float:
        limit = PORT_POLL_S if self._polled else IDLE_S
        if self._bench.clock is Clock.SYNC:
            return limit
        due_s = (self._bench.next_due_ns - (time.monotonic_ns() - self._start_ns)) * 1e-9
        return min(max(due_s, 0.0), limit)

    def _follow_wall_clock(self, now_ns: int, timeout_s: float) -> None:
        gap_ns = now_ns - self._last_look_ns - int(timeout_s * 1e9)
        self._last_look_ns = now_ns
        self._is_behind = gap_ns > STALL_NS
        if self._is_behind:
            self.stalls += 1
            self._gap_ns = min(gap_ns, LONGEST_REPLAY_NS)
            self._start_ns += max(gap_ns - LONGEST_REPLAY_NS, 0)
        else:
            self._bench.advance(now_ns - self._start_ns)

    def _catch_up(self, events: Sequence[Event], now_ns: int) -> None:
        """After a stall: take the input at the times at which it must have arrived, then let time go on.

        Takes no more than a bus could have carried: a faster sender must not keep the emulator busy.
        """
        most = self._gap_ns * self._bench.cell.bus.bitrate // (SHORTEST_FRAME_BITS * 1_000_000_000)
        received = list(self._received(events))
        while len(received) <= most and (events := self._hub.poll(0.0)):
            received += self._received(events)
        frames = [each for each in received if type(each) is Received]
        self._queued_syncs = sum(each.channel == ROBOT_BUS and is_sync(each.frame) for each in frames)
        self._take_all(received, now_ns)
        self._is_behind = False
        self._last_look_ns = time.monotonic_ns()
        self._bench.advance(self._last_look_ns - self._start_ns)

    def _take(self, bus: str, origin: object, frame: Frame, now_ns: int) -> None:
        if bus == ROBOT_BUS:
            self._origin, self._write_out_ns = origin, now_ns + QUIET_NS
            if is_sync(frame):
                self._sync_sender, self._last_heard_ns = origin, now_ns
                if self._bench.clock is Clock.WALL:
                    self.sync_intervals.note(now_ns)
                if self._is_behind:
                    self._advance_to_sync(now_ns - self._start_ns)
                self._last_sync_time_ns = self._bench.time_ns
            elif origin == self._sync_sender:
                self._last_heard_ns = now_ns
            self._bench.receive(frame, origin)
        else:
            if Cob.HEARTBEAT < frame.can_id <= Cob.HEARTBEAT + 0x7F and frame.data != bytes((NmtState.STOPPED,)):
                self._listener_until_ns = now_ns + LISTENER_NS
            self._bench.device.channels.now_ns = now_ns
            self._bench.receive_bench(frame, origin)

    def _advance_to_sync(self, now_ns: int) -> None:
        """Assume that SYNCs which have queued up during a stall came one cycle apart.

        If there are fewer than the stall had cycles, their sender has stalled too, and they came after that.
        """
        cycle_ns, left = self._bench.cell.bus.cycle_ns, self._queued_syncs
        came_ns = self._last_sync_time_ns + cycle_ns
        if now_ns - came_ns > (left + 1) * cycle_ns:
            came_ns = now_ns - (left - 1) * cycle_ns
        self._queued_syncs = left - 1
        self._bench.advance(min(came_ns, now_ns))

    def _client_event(self, event: Event) -> None:
        if isinstance(event, Unreadable):
            shown = event.text[:60].encode("ascii", "backslashreplace").decode()
            self._on_event(
                f"client {event.client_id} on {event.channel or 'no bus'} sends what cannot be read: {shown!r}; it is "
                "dropped and counted, as what follows of the kind"
            )
        elif isinstance(event, Attached):
            self._note("attached", bus=event.channel, client=event.client_id)
        elif isinstance(event, Detached):
            self._note("detached", bus=event.channel, client=event.client_id)
            self._bench.leave(event.client_id)
            self._bench.device.channels.leave(event.client_id)
            if event.channel == ROBOT_BUS:
                self._write_out_ns = 0
                if event.client_id == self._sync_sender:
                    if self._bench.clock is Clock.SYNC:
                        self._run_on("the sender of SYNC has left the bus")
                    self._sync_sender = None

    def _rested(self, took_ns: int) -> None:
        self._deliver(newcomer=self._origin)
        self._note("ran-on", why=RESTED, from_ns=self._bench.time_ns - took_ns)
        self._on_event(f"{RESTED}: virtual time ran on by {took_ns / 1e6:.0f} ms")

    def _run_on(self, why: str) -> None:
        """In lockstep without SYNC, let time run on until the cards have protected themselves."""
        self._sync_sender = None
        if self._bench.is_operational:
            self.run_ons += 1
            before_ns = self._bench.time_ns
            self._bench.run_on()
            self._note("ran-on", why=why, from_ns=before_ns)
            self._deliver()  # who reads the line below may look at once for what the cards have said
            self._on_event(f"{why}: virtual time ran on by {(self._bench.time_ns - before_ns) / 1e6:.0f} ms")

    def _telemetry(self, now_ns: int) -> None:
        if now_ns > self._listener_until_ns:
            return
        cycle = self._bench.cycle
        if (cycle != self._sent_cycle and cycle % DIVIDER == 0) or now_ns >= self._next_idle_telemetry_ns:
            self._sent_cycle = cycle
            self._next_idle_telemetry_ns = now_ns + IDLE_TELEMETRY_NS
            self._bench.send_telemetry()

    def _deliver(self, newcomer: object = None) -> None:
        """Send the bench's frames, in the order of each bus, to everybody but their senders, then to the log.

        For a `newcomer` they are history, and too many at once for some clients.
        """
        bench, hub = self._bench, self._hub
        if bench.records:
            records, bench.records = bench.records, []
            for time_ns, frame, origin in records:
                if frame.can_id < ERROR_FLAG:
                    hub.send(ROBOT_BUS, time_ns, frame, exclude=origin if newcomer is None else newcomer)  # type: ignore[arg-type]
                else:
                    hub.send_error(ROBOT_BUS, time_ns, frame.can_id - ERROR_FLAG)
            hub.flush()
            self._send_to_ports(ROBOT_BUS, records)
            if self._recorder is not None:
                self._recorder.frames(records)
        if bench.bench_records:
            records, bench.bench_records = bench.bench_records, []
            for time_ns, frame, origin in records:
                hub.send(BENCH_BUS, time_ns, frame, exclude=origin)  # type: ignore[arg-type]
            hub.flush()
            self._send_to_ports(BENCH_BUS, records)
            if self._recorder is not None:
                self._recorder.bench_frames(records)

    def _send_to_ports(self, bus: str, records: Sequence[Record]) -> None:
        """Send frames to the ports, except error frames: other buses have their own."""
        for port in self._ports[bus]:
            frames = [
                (time_ns, frame)
                for time_ns, frame, origin in records
                if origin is not port and frame.can_id < ERROR_FLAG
            ]
            if frames:
                port.send_stamped(frames)

    def _count_clients(self, bus: str) -> ClientCounts:
        return ClientCounts(self._hub.attached_to(bus), self._hub.dropped_on(bus))

    def _fault_event(self, event: FaultEvent) -> None:
        if self._recorder is not None:
            self._recorder.fault(event)
        self._on_event(event_text(event))

    def _emergency_stop(self, is_on: bool) -> None:
        if is_on and self.emergency_stop_cycle is None and self._bench.cycle >= 0:
            self._stopped = self._bench.run, self._bench.cycle
        self._note("emergency-stop", state="on" if is_on else "off")
        self._on_event("emergency stop: the supply of all amplifiers is " + ("open" if is_on else "closed again"))

    def _switch_recording(self, is_on: bool) -> None:
        assert self._recorder is not None
        self._deliver()  # what has come so far belongs to the record as it was
        self._recorder.switch(self._bench.time_ns, is_on)
        self._on_event(f"recording: {'on again' if is_on else 'off'}, {self._recorder.place}")

    def _powered_on(self) -> None:
        self._sync_sender = None
        self._note("power-cycle")
        self._on_event("power cycle: the arms are parked, and every card has booted")

    def _record_cycle(self, truth: CycleTruth) -> None:
        assert self._recorder is not None
        if truth.cycle == 0 and self._bench.run != self._recorded_run:
            self._recorded_run = self._bench.run
            self._recorder.begin_run()
        self._recorder.cycle(truth)

    def _note(self, event: str, **details: object) -> None:
        if self._recorder is not None:
            self._recorder.event(self._bench.time_ns, event, cycle=self._bench.cycle, **details)
