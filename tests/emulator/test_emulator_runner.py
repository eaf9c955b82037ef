"""The emulator's runner over the real hub: who is served, when lockstep runs on, who gets telemetry, what is kept."""

import contextlib
import csv
import json
import re
import struct
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from canarm_emulator.bench.bench import Record
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_emulator.serving import runner as runner_module
from canarm_emulator.serving.hub import Hub
from canarm_emulator.serving.hub_events import Received
from canarm_emulator.serving.recording import Recorder
from canarm_emulator.serving.runner import EmulatorRunner
from canarm_emulator.wire.confinement import ErrorKind, ErrorState
from canarm_emulator.wire.error_frames import error_frame
from canarm_emulator.wire.wire_events import ErrorFrame
from canarm_protocol.canopen.frames import Frame, NmtCommand, NmtState, heartbeat_frame, nmt_frame, sync_frame
from canarm_protocol.canopen.sdo import download, upload
from canarm_protocol.cell.bench_objects import FAULT_SET, RECORD_PLACE, RECORDING, bench_pdos, sdo_channel
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock
from canarm_protocol.runs.run_folder import create_run_folder
from canarm_protocol.transport.port import BusPort, Discarded, open_port
from canarm_protocol.transport.sdo_session import SdoSession

CELL = load_cell("konkuk1")
DEADLINE_S = 60.0
TIME = 0x100
NOBODY_WAITS_S = 3600.0
HEARTBEAT = heartbeat_frame(CELL.bus.controller_node_id, NmtState.OPERATIONAL)
LISTENER = heartbeat_frame(0x71, NmtState.OPERATIONAL)
TELEMETRY = {layout.cob_id for pdos in (bench_pdos(CELL),) for layout in (pdos.status, *pdos.truth, *pdos.drive)}


class Emulator:
    """A runner in a thread of its own, and clients of its hub."""

    def __init__(
        self, clock: Clock, folder: Path | None, sync_timeout_s: float, ports: dict[str, list[BusPort]] | None
    ) -> None:
        self.bench = FaultBench(CELL, Truth.from_settings(CELL, {}), clock, seed=0)
        self.hub = Hub(port=0)
        self.recorder = Recorder(folder, CELL) if folder else None
        self.told: list[str] = []
        self.is_over = threading.Event()
        self.runner = EmulatorRunner(
            self.bench, self.hub, ports, self.recorder, sync_timeout_s, self.is_over.is_set, self.told.append
        )
        self.thread = threading.Thread(target=self.runner.run)
        self.clients: list[BusPort] = []

    def client(self, channel: str = "can0") -> BusPort:
        host, port = self.hub.address
        self.clients.append(open_port("canarm", channel, host=host, port=port))
        return self.clients[-1]

    def until(self, condition: Callable[[], bool]) -> None:
        """Waits for what the runner's thread does by itself."""
        deadline_s = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < deadline_s
            assert self.thread.is_alive()
            self.is_over.wait(0.002)


def told_run_on_ms(told: list[str], why: str) -> int:
    """By how much virtual time ran on, as the only line that was told says."""
    (line,) = told
    found = re.fullmatch(rf"{re.escape(why)}: virtual time ran on by (\d+) ms", line)
    assert found is not None, line
    return int(found.group(1))


@contextlib.contextmanager
def serving(
    clock: Clock = Clock.SYNC,
    folder: Path | None = None,
    sync_timeout_s: float = NOBODY_WAITS_S,
    ports: dict[str, list[BusPort]] | None = None,
) -> Iterator[Emulator]:
    emulator = Emulator(clock, folder, sync_timeout_s, ports)
    emulator.thread.start()
    try:
        yield emulator
    finally:
        for client in emulator.clients:
            client.close()
        emulator.is_over.set()
        emulator.thread.join(DEADLINE_S)
        emulator.hub.close()
        if emulator.recorder:
            emulator.recorder.close()
        assert not emulator.thread.is_alive()


def hear(client: BusPort, until: Callable[[Frame], bool]) -> list[Frame]:
    """Frames up to the one that `until` waits for."""
    deadline_s, heard = time.monotonic() + DEADLINE_S, []
    while time.monotonic() < deadline_s:
        heard += [frame for _, frame in client.receive(1.0)]
        if any(until(frame) for frame in heard):
            return heard
    raise AssertionError(f"heard only {heard}")


def cycle(client: BusPort, *frames: Frame) -> list[Frame]:
    """One lockstep cycle of a controller: outputs and SYNC out, everything up to TIME in."""
    client.send([*frames, sync_frame(None)])
    return hear(client, lambda frame: frame.can_id == TIME)


def start_watched(client: BusPort) -> None:
    """All cards watch the controller's heartbeat for 100 ms of virtual time, then start."""
    for node_id in (0x12, 0x13, 0x14):
        session = SdoSession(client, 0x600 + node_id, 0x580 + node_id, DEADLINE_S)
        session.download(0x1016, 1, struct.pack("<I", 1 << 16 | 100))
    client.send([HEARTBEAT, nmt_frame(NmtCommand.START)])


def outputs(code: int) -> list[Frame]:
    return [Frame(0x312, struct.pack("<4h", code << 7, code << 7, 0, 0)), Frame(0x213, b"\x06")]


def swing(client: BusPort, cycles: int) -> None:
    for k in range(cycles):
        cycle(client, HEARTBEAT, *outputs(40 + k % 16))


def is_emcy(frame: Frame) -> bool:
    return frame.can_id == 0x94 and frame.data[:2] == b"\x30\x81"


def test_a_lockstep_cycle_over_the_hub_gives_the_sender_everything_but_its_own_frames() -> None:
    with serving() as emulator:
        controller = emulator.client()
        controller.send([nmt_frame(NmtCommand.START)])
        assert [frame.can_id for frame in cycle(controller)] == [0x294, 0x394, TIME]


def test_another_client_sees_the_whole_bus_in_its_order() -> None:
    with serving() as emulator:
        controller, observer = emulator.client(), emulator.client()
        controller.send([nmt_frame(NmtCommand.START)])
        cycle(controller, *outputs(1))
        heard = hear(observer, lambda frame: frame.can_id == TIME)
        assert [frame.can_id for frame in heard] == [0x000, 0x312, 0x213, 0x080, 0x294, 0x394, TIME]


def test_when_the_sender_of_sync_leaves_the_world_runs_on_and_the_cards_protect_themselves(tmp_path) -> None:
    folder = create_run_folder(tmp_path / "run")
    with serving(folder=folder) as emulator:
        observer, controller = emulator.client(), emulator.client()
        start_watched(controller)
        swing(controller, 10)
        controller.close()
        hear(observer, is_emcy)
        emulator.until(lambda: bool(emulator.told))
        assert emulator.runner.run_ons == 1
        assert told_run_on_ms(emulator.told, "the sender of SYNC has left the bus") >= 600
        assert not emulator.bench.is_operational
        assert [joint.command_a for joint in emulator.bench.world.state()] == [0.0, 0.0]
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    (ran_on,) = [event for event in events if event["event"] == "ran-on"]
    assert ran_on["power_on_s"] - ran_on["from_ns"] * 1e-9 >= 0.6
    assert ran_on["why"] == "the sender of SYNC has left the bus"
    assert [event["event"] for event in events].count("attached") == 2


def test_a_client_that_sends_no_sync_may_leave() -> None:
    with serving() as emulator:
        controller, other = emulator.client(), emulator.client()
        start_watched(controller)
        swing(controller, 2)
        other.send([Frame(0x80, b"\1", is_extended=True)])
        other.close()
        emulator.until(lambda: len(emulator.hub.clients) == 1)
        swing(controller, 2)
        assert emulator.runner.run_ons == 0
        assert emulator.bench.is_operational


def test_when_the_sender_of_sync_falls_silent_the_world_runs_on_once() -> None:
    with serving(sync_timeout_s=0.2) as emulator:
        controller = emulator.client()
        start_watched(controller)
        controller.send([*outputs(40), sync_frame(None)])
        hear(controller, is_emcy)
        emulator.until(lambda: bool(emulator.told))
        assert told_run_on_ms(emulator.told, "no SYNC for 0.2 s") >= 600
        assert emulator.runner.run_ons == 1
        cycle(controller)  # and time moves again with the next SYNC


def test_the_sender_of_sync_may_take_its_time_as_long_as_it_says_something() -> None:
    """Somebody who steps by hand thinks between two cycles; the heartbeat shows that nobody is lost."""
    with serving(sync_timeout_s=1.0) as emulator:
        controller = emulator.client()
        start_watched(controller)
        controller.send([*outputs(40), sync_frame(None)])
        end_s = time.monotonic() + 1.5
        while time.monotonic() < end_s:
            controller.send([heartbeat_frame(1, NmtState.OPERATIONAL)])
            controller.receive(0.02)
        assert emulator.runner.run_ons == 0
        hear(controller, is_emcy)  # and now it falls silent


def test_before_nmt_start_a_silent_bus_stands_still() -> None:
    with serving(sync_timeout_s=0.0) as emulator:
        controller = emulator.client()
        for _ in range(3):
            cycle(controller)
        emulator.until(lambda: emulator.runner._sync_sender is None)
        assert emulator.runner.run_ons == 0
        assert emulator.bench.time_ns == 2 * CELL.bus.cycle_ns


def ask_bench(client: BusPort) -> list[int]:
    """COB-IDs heard on the bench bus up to the answer to a question."""
    request_id, answer_id = sdo_channel(0x70, 3)
    client.send([Frame(request_id, next(upload(0x2100, 1)))])
    return [frame.can_id for frame in hear(client, lambda frame: frame.can_id == answer_id)]


def test_telemetry_is_sent_while_a_listener_shows_itself() -> None:
    with serving() as emulator:
        controller, dashboard = emulator.client(), emulator.client("bench")
        controller.send([nmt_frame(NmtCommand.START)])
        swing(controller, 12)
        assert not TELEMETRY & set(ask_bench(dashboard))
        dashboard.send([LISTENER])
        hear(dashboard, lambda frame: frame.can_id in TELEMETRY)
        swing(controller, 12)
        heard = ask_bench(dashboard)
        assert set(heard) >= TELEMETRY
        assert heard.count(0x1F0) >= 2  # at least two of every fourth cycle of twelve


def test_telemetry_ends_with_the_listeners_heartbeat(monkeypatch) -> None:
    monkeypatch.setattr(runner_module, "LISTENER_NS", 0)
    with serving() as emulator:
        controller, dashboard = emulator.client(), emulator.client("bench")
        controller.send([nmt_frame(NmtCommand.START)])
        dashboard.send([LISTENER])
        ask_bench(dashboard)
        swing(controller, 12)
        assert not TELEMETRY & set(ask_bench(dashboard))


def test_a_listener_that_says_goodbye_gets_no_telemetry() -> None:
    with serving() as emulator:
        dashboard = emulator.client("bench")
        dashboard.send([heartbeat_frame(0x71, NmtState.STOPPED)])
        assert not TELEMETRY & {*ask_bench(dashboard), *ask_bench(dashboard)}


def recorded(folder: Path, is_busy: bool) -> dict[str, bytes]:
    """Files of a run, during which somebody on the bench bus asks and writes all the time, or nobody does."""
    create_run_folder(folder)
    with serving(folder=folder) as emulator:
        controller, dashboard = emulator.client(), emulator.client("bench") if is_busy else None
        start_watched(controller)
        for k in range(60):
            cycle(controller, HEARTBEAT, *outputs(40 + k % 16))
            if dashboard:
                dashboard.send([LISTENER, sync_frame(None), Frame(0x670, next(download(0x1017, 0, b"\x01\x00")))])
                ask_bench(dashboard)
        cycle(controller, nmt_frame(NmtCommand.PRE_OPERATIONAL))  # or the world would run on when the controller leaves
    return {name: (folder / name).read_bytes() for name in ("can0.log", "signals/robot.csv")}


def test_a_client_on_bench_does_not_change_a_byte_of_the_robots_records(tmp_path) -> None:
    quiet, busy = recorded(tmp_path / "quiet", False), recorded(tmp_path / "busy", True)
    assert quiet == busy
    assert quiet["can0.log"].count(b" 080#\n") == 61


def test_the_recorder_leaves_a_row_of_truth_a_cycle(tmp_path) -> None:
    recorded(tmp_path / "run", False)
    with (tmp_path / "run" / "signals" / "robot.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["cycle"]) for row in rows] == list(range(60))
    assert [float(row["time_s"]) for row in rows] == pytest.approx([k * 0.0025 for k in range(60)])
    assert float(rows[0]["joint2.true_angle_rad"]) == pytest.approx(0.349066)
    assert float(rows[1]["joint3.command_a"]) == pytest.approx(-41 / 255 * 1.5)


def test_a_record_that_was_off_for_a_while_is_well_formed_and_says_so(tmp_path: Path) -> None:
    """Frames and signals of cycles 3 to 5 are missing; the fault that begins there is among the events."""
    folder = create_run_folder(tmp_path / "run")
    with serving(folder=folder) as emulator:
        controller, dashboard = emulator.client(), emulator.client("bench")
        channel = SdoSession(dashboard, *sdo_channel(0x70, 0), DEADLINE_S)
        controller.send([nmt_frame(NmtCommand.START)])
        swing(controller, 3)
        channel.download(RECORDING, 0, b"\0")
        channel.download(FAULT_SET, 0, b'[[set]]\n[[set.fault]]\ntap = "joint2.tachometer"\nfault = "stuck"\n')
        swing(controller, 3)
        channel.download(RECORDING, 0, b"\1")
        swing(controller, 3)
        assert channel.upload(RECORD_PLACE).decode() == str(folder)
        cycle(controller, nmt_frame(NmtCommand.PRE_OPERATIONAL))
    with (folder / "signals" / "robot.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["cycle"]) for row in rows] == [0, 1, 2, 6, 7, 8]
    assert [float(row["time_s"]) for row in rows[3:]] == pytest.approx([0.015, 0.0175, 0.02])
    log = (folder / "can0.log").read_bytes()
    assert log.count(b" 080#\n") == 7, "six cycles, and one after the run"
    assert log.endswith(b"\n")
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    assert [(each["state"], each["cycle"]) for each in events if each["event"] == "recording"] == [
        ("off", 2),
        ("on", 5),
    ]
    assert [each["cycle"] for each in events if each["event"] == "fault-begins"] == [3]


@pytest.mark.parametrize("leaves", [True, False], ids=["leaves", "falls silent"])
def test_the_record_of_a_run_is_whole_on_disk_though_the_emulator_goes_on(leaves: bool, tmp_path: Path) -> None:
    folder = create_run_folder(tmp_path / "run")
    with serving(folder=folder) as emulator:
        client = emulator.client()
        client.send([nmt_frame(NmtCommand.START)])
        swing(client, 3)
        client.send([nmt_frame(NmtCommand.STOP)])
        if leaves:
            client.close()
        emulator.until(lambda: (folder / "can0.log").read_text().endswith(" 000#0200\n"))
        emulator.until(lambda: (folder / "signals" / "robot.csv").read_text().count("\n") == 1 + 3)


def test_on_the_wall_clock_the_world_moves_by_itself() -> None:
    with serving(Clock.WALL) as emulator:
        client = emulator.client()
        session = SdoSession(client, 0x612, 0x592, DEADLINE_S)
        assert session.upload(0x2000) == bytes((Clock.WALL.value,))
        session.download(0x1017, 0, struct.pack("<H", 10))
        beats: list[Frame] = []
        while len(beats) < 3:
            beats += [frame for frame in hear(client, lambda frame: frame.can_id == 0x712) if frame.can_id == 0x712]
        assert set(beats) == {heartbeat_frame(0x12, NmtState.PRE_OPERATIONAL)}
        client.send([nmt_frame(NmtCommand.START), sync_frame(None)])
        hear(client, lambda frame: frame.can_id == 0x394)


class ListPort(BusPort):
    """A bus that is two lists, without anything that `select` could wait for."""

    description = "list"

    def __init__(self, *frames: Frame) -> None:
        self.discarded = Discarded()
        self._incoming = list(frames)
        self.sent: list[Frame] = []

    def send(self, frames) -> None:
        self.sent += frames

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        frames, self._incoming = self._incoming, []
        return [(0, frame) for frame in frames]

    def fileno(self) -> None:
        return None

    def close(self) -> None:
        pass


def test_further_ports_are_part_of_their_bus() -> None:
    port, bench_port = ListPort(nmt_frame(NmtCommand.START), sync_frame(None)), ListPort(LISTENER)
    with serving(ports={"can0": [port], "bench": [bench_port]}) as emulator:
        emulator.until(lambda: bool(port.sent) and port.sent[-1].can_id == TIME)
        assert [frame.can_id for frame in port.sent] == [0x712, 0x713, 0x714, 0x294, 0x394, TIME]
        emulator.until(lambda: {frame.can_id for frame in bench_port.sent} >= TELEMETRY)
        assert LISTENER not in bench_port.sent
        client = emulator.client()
        cycle(client, Frame(0x123, b"\1"))
        emulator.until(lambda: port.sent[-1].can_id == TIME and Frame(0x123, b"\1") in port.sent)


def test_the_bench_node_shows_who_is_attached() -> None:
    with serving() as emulator:
        emulator.client()
        request_id, answer_id = sdo_channel(0x70, 3)
        clients = emulator.client("bench"), emulator.client("bench")
        for subindex, expected in ((1, 1), (2, 2)):
            clients[0].send([Frame(request_id, next(upload(0x2321, subindex)))])
            answer = hear(clients[0], lambda frame: frame.can_id == answer_id)[-1]
            assert answer.data[:6] == bytes((0x4B, 0x21, 0x23, subindex, expected, 0))


def test_error_frames_stay_away_from_other_buses() -> None:
    """They reach clients of the virtual bus; a real bus has errors of its own, and no driver sends any."""
    port = ListPort()
    emulator = Emulator(Clock.SYNC, None, NOBODY_WAITS_S, {"can0": [port]})
    event = ErrorFrame(0, ErrorKind.BIT, Frame(0x294), 0x14)
    emulator.bench.records.append(Record(0, error_frame(event, ErrorState.ACTIVE, None), event))
    emulator.is_over.set()
    emulator.runner.run()
    emulator.hub.close()
    assert [frame.can_id for frame in port.sent] == [0x712, 0x713, 0x714]


def test_a_stall_is_caught_up_with_no_more_than_a_bus_could_have_carried(monkeypatch) -> None:
    """A client that floods must not keep the emulator for itself: at 1 Mbit/s a frame has 47 bits at least."""
    bench = FaultBench(CELL, Truth.from_settings(CELL), Clock.WALL, 0, with_wire=True)
    hub = Hub(port=0)
    asked = 0

    def poll(timeout_s: float) -> list[Received]:
        nonlocal asked
        asked += 1
        if asked == 1:  # the machine stalls: the clock goes on by 20 ms more than was waited for
            monkeypatch.setattr(runner_module.time, "monotonic_ns", lambda: 25_000_000)
        return [Received("can0", 1, Frame(0x7F0, bytes(8)))] * 100

    try:
        monkeypatch.setattr(runner_module.time, "monotonic_ns", lambda: 0)
        monkeypatch.setattr(hub, "poll", poll)
        questions = iter([False, True])
        EmulatorRunner(bench, hub, should_stop=lambda: next(questions)).run()
    finally:
        hub.close()
    assert 2 <= asked <= 8
    assert bench.trouble.lost_frames == 100 * asked - 256


@pytest.mark.parametrize(
    ("queued", "expected_ms"),
    [
        (26, [2.5 * cycle for cycle in range(1, 27)]),  # the controller went on: its SYNCs came as ever
        (2, [65.5, 68.0]),  # it has stood still as well, and has gone on by now
    ],
)
def test_syncs_that_queued_up_in_a_stall_came_one_cycle_apart_until_now(
    monkeypatch, queued: int, expected_ms: list[float]
) -> None:
    bench = FaultBench(CELL, Truth.from_settings(CELL), Clock.WALL, 0)
    hub = Hub(port=0)
    sync = Received("can0", 1, sync_frame(None))
    answers = iter([[Received("can0", 1, nmt_frame(NmtCommand.START)), sync], [sync] * queued])
    is_stalled = iter([False, True])

    def poll(timeout_s: float) -> list[Received]:
        found = next(answers, [])
        if found and next(is_stalled):
            monkeypatch.setattr(runner_module.time, "monotonic_ns", lambda: 68_000_000)
        return found

    try:
        monkeypatch.setattr(runner_module.time, "monotonic_ns", lambda: 0)
        monkeypatch.setattr(hub, "poll", poll)
        times_ns: dict[int, int] = {}
        bench.on_cycle = lambda truth: times_ns.setdefault(truth.cycle, truth.time_ns)
        questions = iter([False, False, True])
        EmulatorRunner(bench, hub, should_stop=lambda: next(questions)).run()
    finally:
        hub.close()
    assert [time_ns / 1e6 for time_ns in times_ns.values()] == pytest.approx([0.0, *expected_ms])


def test_who_is_told_that_the_emulator_is_ready_meets_cards_that_have_booted() -> None:
    """A reset, a boot-up and a request in a row: the boot-up heard must not be that of power-on."""
    bench = FaultBench(CELL, Truth.from_settings(CELL), Clock.WALL, 0)
    hub = Hub(port=0)
    states: list[NmtState] = []
    try:
        EmulatorRunner(
            bench, hub, should_stop=lambda: True, on_ready=lambda: states.extend(slave.state for slave in bench.slaves)
        ).run()
    finally:
        hub.close()
    assert states == [NmtState.PRE_OPERATIONAL] * len(CELL.card)
