"""Trouble on the wire as cards, clients, the log and the bench bus show it.

Counts by ISO 11898-1:2015, 12.1.4.2: an error adds 8 to the sender's counter (rule c), 128 is error-passive (rule i),
256 is bus-off (rule k), a frame sent takes 1 off (rule g), 128 times 11 recessive bits end bus-off (rule l). Error
classes by linux/can/error.h, EMCY codes by CiA 301, table 26.
"""

import json
import math
import struct
import threading
from collections.abc import Callable
from pathlib import Path

import can
import pytest

from canarm_emulator.bench.bench import Record
from canarm_emulator.bench_node.bus_figures import ClientCounts
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_emulator.serving.hub import Hub
from canarm_emulator.serving.recording import Recorder
from canarm_emulator.serving.runner import EmulatorRunner
from canarm_emulator.wire.bus_trouble import ClientNode
from canarm_emulator.wire.confinement import ErrorState
from canarm_emulator.wire.wire_events import StateChange
from canarm_protocol.canopen.frames import Frame, NmtCommand, NmtState, nmt_frame, sync_frame
from canarm_protocol.canopen.sdo import download, upload
from canarm_protocol.cell.bench_objects import bench_pdos
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock
from canarm_protocol.runs.run_folder import create_run_folder

CELL = load_cell("konkuk1")
DAC, LATCH, ADC, BENCH_NODE = 0x12, 0x13, 0x14, CELL.bus.bench_node_id
BIT_NS = 1000
ERRORS_TO_PASSIVE, ERRORS_TO_BUS_OFF = 128 // 8, 256 // 8
RECOVERY_NS = 128 * 11 * BIT_NS
CRTL, PROT, ACK, BUSOFF, BUSERROR, RESTARTED = 0x004, 0x008, 0x020, 0x040, 0x080, 0x100
ERROR_FLAG = 0x2000_0000
CURRENTS, DIRECTIONS = Frame(0x312, b"\x80\x7f" + bytes(6)), Frame(0x213, b"\x02")
TPDO = 0x294
MASTER = "master"

MakeBench = Callable[..., FaultBench]


@pytest.fixture
def make_bench() -> MakeBench:
    def make(clock: Clock = Clock.SYNC, with_wire: bool = True) -> FaultBench:
        bench = FaultBench(CELL, Truth.from_settings(CELL), clock, 0, with_wire)
        bench.start()
        # 1.5 A while it runs; the card's heartbeat is a frame that it sends by itself.
        write(bench, DAC, 0x1017, 0, struct.pack("<H", 1))
        bench.receive(nmt_frame(NmtCommand.START), MASTER)
        return bench

    return make


def write(bench: FaultBench, node_id: int, index: int, subindex: int, data: bytes) -> None:
    bench.receive(Frame(0x600 + node_id, next(download(index, subindex, data))), MASTER)


def cycles(bench: FaultBench, count: int, *frames: Frame, origin: object = MASTER) -> list[Record]:
    bench.records.clear()
    for _ in range(count):
        for frame in frames:
            bench.receive(frame, origin)
        bench.receive(sync_frame(None), origin)
    return list(bench.records)


def emergencies(records: list[Record], node_id: int) -> list[str]:
    return [record.frame.data[:3].hex() for record in records if record.frame.can_id == 0x80 + node_id]


def changes(records: list[Record]) -> list[tuple[object, ErrorState]]:
    return [(r.origin.node, r.origin.state) for r in records if isinstance(r.origin, StateChange)]


def classes(records: list[Record]) -> list[int]:
    """Error classes, without the bit that says that counters are there."""
    return [record.frame.can_id & ~(ERROR_FLAG | 0x200) for record in records if record.frame.is_error]


def slave(bench: FaultBench, node_id: int):
    return next(each for each in bench.slaves if each.node_id == node_id)


def test_a_card_says_that_it_is_error_passive_and_when_it_is_active_again(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.wire.corrupt(TPDO, times=ERRORS_TO_PASSIVE, bit=20)
    records = cycles(bench, 4)
    assert changes(records) == [(ADC, ErrorState.PASSIVE), (ADC, ErrorState.ACTIVE)]
    assert emergencies(records, ADC) == ["208111", "000000"]
    assert slave(bench, ADC).state is NmtState.OPERATIONAL


def test_one_error_less_and_nobody_says_anything(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.wire.corrupt(TPDO, times=ERRORS_TO_PASSIVE - 1, bit=20)
    records = cycles(bench, 4)
    assert bench.wire.nodes[ADC].tec > 0
    assert changes(records) == emergencies(records, ADC) == []
    assert classes(records) == [PROT | BUSERROR] * (ERRORS_TO_PASSIVE - 1)


def test_the_list_of_events_does_not_grow(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.wire.corrupt(TPDO, times=5)
    cycles(bench, 3)
    assert bench.trouble.error_frames == 5
    assert bench.wire.events == []


@pytest.mark.parametrize(
    ("behaviour", "state"), [(0, NmtState.PRE_OPERATIONAL), (1, NmtState.OPERATIONAL), (2, NmtState.STOPPED)]
)
def test_bus_off_does_what_a_lost_heartbeat_does(make_bench: MakeBench, behaviour: int, state: NmtState) -> None:
    """CiA 301, 0x1029:1; CiA 401's error values: no current."""
    bench = make_bench()
    bench.receive(nmt_frame(NmtCommand.PRE_OPERATIONAL), MASTER)
    write(bench, DAC, 0x1029, 1, bytes((behaviour,)))
    bench.receive(nmt_frame(NmtCommand.START), MASTER)
    bench.trouble.held.add(DAC)
    cycles(bench, 3, CURRENTS, DIRECTIONS)
    assert bench.world.state()[0].command_a == pytest.approx(1.5)
    bench.wire.corrupt(0x712, times=ERRORS_TO_BUS_OFF, bit=3)
    records = cycles(bench, 8, CURRENTS)
    assert (DAC, ErrorState.BUS_OFF) in changes(records)
    assert bench.world.state()[0].command_a == 0.0
    assert slave(bench, DAC).state is state


def test_a_card_in_bus_off_comes_back_by_itself_after_128_times_11_recessive_bits(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.wire.corrupt(0x712, times=ERRORS_TO_BUS_OFF, bit=3)
    records = cycles(bench, 10)
    states = [(r.time_ns, r.origin.state) for r in records if isinstance(r.origin, StateChange)]
    (_, passive), (off_ns, off), (back_ns, active) = states
    assert (passive, off, active) == (ErrorState.PASSIVE, ErrorState.BUS_OFF, ErrorState.ACTIVE)
    assert back_ns - off_ns >= RECOVERY_NS
    silent = [record for record in records if off_ns < record.time_ns < back_ns]
    assert not [record for record in silent if record.frame.can_id in (0x712, 0x092)]
    # What it had to say before is lost: the first thing heard is 0x8140, then that both errors are over.
    assert emergencies(records, DAC) == ["408111", "000011", "000000"]
    assert classes(records)[-1] == RESTARTED
    assert [r.frame for r in records if r.time_ns > back_ns and r.frame.can_id == 0x712]
    assert bench.trouble.lost_frames == bench.wire.nodes[DAC].discarded > 0


def test_a_card_in_bus_off_hears_neither_sync_nor_nmt_nor_sdo(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.trouble.held.add(ADC)
    bench.wire.corrupt(TPDO, times=ERRORS_TO_BUS_OFF, bit=20)
    cycles(bench, 6)
    assert ADC in bench.trouble.off
    records = cycles(bench, 2, nmt_frame(NmtCommand.STOP, ADC), Frame(0x614, next(upload(0x1000, 0))))
    assert slave(bench, ADC).state is not NmtState.STOPPED
    assert not [record for record in records if record.frame.can_id in (TPDO, 0x594)]
    bench.receive(nmt_frame(NmtCommand.STOP), MASTER)
    cycles(bench, 2)
    assert slave(bench, LATCH).state is NmtState.STOPPED
    assert slave(bench, ADC).state is not NmtState.STOPPED


def test_one_that_is_held_in_bus_off_comes_back_when_somebody_says_so(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.trouble.held.add(DAC)
    bench.wire.corrupt(0x712, times=ERRORS_TO_BUS_OFF, bit=3)
    cycles(bench, 20)
    assert DAC in bench.trouble.off
    bench.bus.recover(DAC)
    records = cycles(bench, 4)
    assert emergencies(records, DAC)[0] == "408111"
    assert bench.trouble.off == set()


def test_recovery_does_not_hold_up_the_cycles_inputs(make_bench: MakeBench) -> None:
    """TIME ends a cycle when the inputs are there, not when a silent card is back."""
    bench = make_bench()
    bench.trouble.held.add(DAC)
    bench.wire.corrupt(0x712, times=ERRORS_TO_BUS_OFF, bit=3)
    cycles(bench, 8)
    (usual,) = [r.time_ns for r in cycles(bench, 1) if r.frame.can_id == 0x100]
    # So late in the cycle that it ends between the next one's inputs and the SYNC after them.
    bench.advance(bench.time_ns + RECOVERY_NS - 200_000)
    bench.bus.recover(DAC)
    (time_ns,) = [r.time_ns for r in cycles(bench, 1) if r.frame.can_id == 0x100]
    assert DAC in bench.trouble.off
    assert time_ns - usual == pytest.approx(CELL.bus.cycle_ns, abs=20 * BIT_NS)
    cycles(bench, 1)
    assert DAC not in bench.trouble.off


def test_a_clients_frames_are_lost_and_counted_until_its_node_has_recovered(make_bench: MakeBench) -> None:
    bench = make_bench()
    cycles(bench, 2, CURRENTS)
    bench.trouble.held.add(MASTER)
    bench.wire.corrupt(0x312, times=ERRORS_TO_BUS_OFF, bit=20)
    cycles(bench, 8, CURRENTS)
    assert bench.trouble.off == {MASTER}
    before, cycle = bench.trouble.lost_frames, bench.cycle
    records = cycles(bench, 3, CURRENTS)
    assert bench.trouble.lost_frames - before == 3
    # Lockstep goes on, but no card sees this SYNC.
    assert bench.cycle == cycle + 3
    assert not [record for record in records if record.frame.can_id in (0x312, TPDO)]
    bench.bus.recover(MASTER)
    records = cycles(bench, 4, CURRENTS)
    assert {0x312, TPDO} <= {record.frame.can_id for record in records}
    lost = bench.trouble.lost_frames
    bench.leave(MASTER)
    assert MASTER not in bench.wire.nodes
    assert bench.trouble.lost_frames == lost


def test_on_the_wall_clock_the_sync_of_a_client_in_bus_off_is_lost_too(make_bench: MakeBench) -> None:
    bench = make_bench(Clock.WALL)
    bench.receive(sync_frame(None), MASTER)
    bench.trouble.held.add(MASTER)
    bench.wire.corrupt(0x312, times=ERRORS_TO_BUS_OFF, bit=20)
    bench.receive(CURRENTS, MASTER)
    bench.advance(bench.time_ns + 20_000_000)
    cycle, lost = bench.cycle, bench.trouble.lost_frames
    bench.records.clear()
    bench.receive(sync_frame(None), MASTER)
    assert (bench.cycle, bench.records, bench.trouble.lost_frames) == (cycle, [], lost + 1)


def test_a_client_whose_number_is_a_cards_node_id_is_not_taken_for_the_card(make_bench: MakeBench) -> None:
    bench = make_bench()
    cycles(bench, 1, origin=DAC)
    records = cycles(bench, 2, CURRENTS, DIRECTIONS, origin=DAC)
    assert {record.origin for record in records if record.frame.can_id == 0x312} == {DAC}
    assert bench.wire.nodes[ClientNode(DAC)].sent > 0
    assert bench.world.state()[0].command_a == pytest.approx(1.5)
    bench.leave(DAC)
    assert set(bench.wire.nodes) == {DAC, LATCH, ADC}


def test_error_frames_have_the_classes_and_details_of_linux(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.wire.corrupt(TPDO)
    (crc,) = [record.frame for record in cycles(bench, 2) if record.frame.is_error]
    # CAN_ERR_PROT_TX and CAN_ERR_PROT_LOC_CRC_SEQ; the sender's TEC and REC.
    assert crc.data == bytes((0, 0, 0x80, 0x08, 0, 0, 8, 0))
    bench.wire.corrupt(TPDO, bit=20)
    (bit,) = [record.frame for record in cycles(bench, 2) if record.frame.is_error]
    assert bit.data[2:4] == bytes((0x80 | 0x01, 0))  # CAN_ERR_PROT_BIT
    assert {crc.can_id, bit.can_id} == {ERROR_FLAG | PROT | BUSERROR | 0x200}
    bench.wire.corrupt(TPDO, times=ERRORS_TO_BUS_OFF, bit=20)
    records = [record for record in cycles(bench, 12) if isinstance(record.origin, StateChange)]
    assert classes(records) == [CRTL | BUSERROR, BUSOFF | BUSERROR, RESTARTED]
    passive, off, restarted = (record.frame.data for record in records)
    assert passive[1] == 0x20  # CAN_ERR_CRTL_TX_PASSIVE
    assert passive[6] >= 128
    assert off[6] == 255  # a byte is not enough
    assert restarted[6:] == bytes(2)


def test_nobody_acknowledges_where_all_others_are_in_bus_off(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.receive(nmt_frame(NmtCommand.PRE_OPERATIONAL), MASTER)
    write(bench, LATCH, 0x1017, 0, struct.pack("<H", 1))
    bench.receive(nmt_frame(NmtCommand.START), MASTER)
    cycles(bench, 2, CURRENTS)
    bench.trouble.held |= {DAC, LATCH, ADC}
    for can_id in (0x712, 0x713, TPDO):
        bench.wire.corrupt(can_id, times=ERRORS_TO_BUS_OFF, bit=3)
    cycles(bench, 12)
    assert bench.trouble.off == {DAC, LATCH, ADC}
    assert not bench.is_operational
    bench.wire.offer(bench.wire.time_ns, CURRENTS, MASTER)
    bench.records.clear()
    bench.settle()
    assert PROT | ACK | BUSERROR in classes(bench.records)
    # An error-passive node alone on the bus counts no further (rule c, exception 1), and the end of the run comes.
    assert bench.wire.nodes[MASTER].state is ErrorState.PASSIVE


def test_python_can_reads_error_frames_back_from_the_log_and_events_name_the_node(
    make_bench: MakeBench, tmp_path: Path
) -> None:
    bench = make_bench()
    cycles(bench, 1, origin=7)
    bench.wire.corrupt(0x712, times=ERRORS_TO_BUS_OFF, bit=3)
    bench.wire.corrupt(0x312)
    records = cycles(bench, 10, CURRENTS, origin=7)
    recorder = Recorder(create_run_folder(tmp_path / "run"), CELL)
    for record in records:
        recorder.frames([record])
    recorder.close()
    log = (tmp_path / "run" / "can0.log").read_text().splitlines()
    assert any(line.split()[2].startswith("20000288#00008") and len(line.split()[2]) == 25 for line in log)
    messages = list(can.CanutilsLogReader(tmp_path / "run" / "can0.log"))
    told = [record for record in records if record.frame.can_id & BUSERROR and record.frame.is_error]
    assert sum(message.is_error_frame for message in messages) == len(told) == ERRORS_TO_BUS_OFF + 1 + 2
    assert not [message for message in messages if message.is_extended_id and not message.is_error_frame]
    events = [json.loads(line) for line in (tmp_path / "run" / "events.jsonl").read_text().splitlines()]
    errors = [event for event in events if event["event"] == "error-frame"]
    assert {(event["kind"], event["frame"], event.get("node"), event.get("client")) for event in errors} == {
        ("bit error", "0x712", DAC, None),
        ("CRC error", "0x312", None, 7),
    }
    states = [(event["node"], event["state"]) for event in events if event["event"] == "error-state"]
    assert states == [(DAC, "error-passive"), (DAC, "bus-off"), (DAC, "error-active")]


@pytest.mark.parametrize("interface", ["canarm", "socketcand"])
def test_clients_see_error_frames_and_go_on_receiving(make_bench: MakeBench, interface: str) -> None:
    bench = make_bench()
    with_hub = Hub(port=0)
    host, port = with_hub.address
    rounds = iter(range(1 << 30))
    state = {"stop": False}
    runner = EmulatorRunner(bench, with_hub, should_stop=lambda: state["stop"] or next(rounds) > 4000)
    thread = threading.Thread(target=runner.run)
    thread.start()
    try:
        with can.Bus(interface=interface, channel="can0", host=host, port=port) as bus:
            bus.send(can.Message(arbitration_id=0, data=bytes((1, 0)), is_extended_id=False))
            bench.wire.corrupt(TPDO, times=3)
            heard: list[can.Message] = []
            for counter in (1, 2, 3):
                bus.send(can.Message(arbitration_id=0x80, data=bytes((counter,)), is_extended_id=False))
                while not heard or heard[-1].arbitration_id != 0x100:
                    message = bus.recv(10.0)
                    assert message is not None
                    heard.append(message)
                heard.append(can.Message(arbitration_id=0x7FF))
    finally:
        state["stop"] = True
        thread.join(30.0)
        with_hub.close()
    errors = [message for message in heard if message.is_error_frame]
    assert len(errors) == 3
    assert {message.arbitration_id & 0xFF for message in errors} == {PROT | BUSERROR}
    assert [message.arbitration_id for message in heard].count(TPDO) == 3
    assert [message.arbitration_id for message in heard].count(0x100) == 3


def read(bench: FaultBench, index: int, subindex: int = 0) -> bytes:
    bench.bench_records.clear()
    bench.receive_bench(Frame(0x600 + BENCH_NODE, next(upload(index, subindex))), "client")
    answer = bench.bench_records[-1].frame.data
    assert answer[0] & 0xE3 == 0x43, answer.hex()
    return answer[4 : 8 - (answer[0] >> 2 & 3)]


def number(bench: FaultBench, index: int, subindex: int = 0) -> int:
    return int.from_bytes(read(bench, index, subindex), "little")


def measured(bench: FaultBench, index: int) -> float:
    return struct.unpack("<f", read(bench, index))[0]


def test_the_bench_node_shows_load_response_errors_and_states(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.trouble.held.add(ADC)
    cycles(bench, 40, CURRENTS)
    assert measured(bench, 0x2301) == pytest.approx(bench.wire.load(), rel=1e-6)
    assert measured(bench, 0x2300) == pytest.approx(bench.wire.load(1_000_000_000), rel=1e-6)
    worst = max(bench.wire.worst_response_ns.values())
    assert measured(bench, 0x2302) == pytest.approx(worst / 1000)
    assert bench.wire.worst_response_ns[number(bench, 0x2303), False] == worst
    bench.wire.corrupt(TPDO, times=ERRORS_TO_BUS_OFF, bit=20)
    cycles(bench, 8)
    assert number(bench, 0x2304) == ERRORS_TO_BUS_OFF
    assert number(bench, 0x2305) == bench.trouble.lost_frames > 0
    assert [number(bench, 0x2312, card) for card in (1, 2, 3)] == [0, 0, 2]
    assert number(bench, 0x2310, 3) == 256
    # Rule b's 8 are for the first to see an error: here they answer the sender's flag, one each (rule a), and good
    # frames take them off again.
    assert number(bench, 0x2311, 3) == bench.wire.nodes[ADC].rec


def test_receive_errors_are_shown_as_they_are(make_bench: MakeBench) -> None:
    """The card that finds a CRC error alone sees the others answer its flag: 1 (rule a) and 8 (rule b)."""
    bench = make_bench()
    bench.wire.corrupt(0x394, receivers=[LATCH])
    bench.receive(sync_frame(None), MASTER)
    # The retransmission, received, takes one off (rule h).
    assert number(bench, 0x2311, 2) == 1 + 8 - 1
    assert number(bench, 0x2310, 3) == 8 - 1


def test_without_a_wire_the_counts_are_0_and_the_measurements_no_numbers(make_bench: MakeBench) -> None:
    bench = make_bench(with_wire=False)
    cycles(bench, 4)
    assert all(math.isnan(measured(bench, index)) for index in (0x2300, 0x2301, 0x2302))
    assert [number(bench, index) for index in (0x2303, 0x2304, 0x2305)] == [0, 0, 0]
    assert [number(bench, index, card) for index in (0x2310, 0x2311, 0x2312) for card in (1, 2, 3)] == [0] * 9


def test_clients_and_dropped_frames_are_what_the_server_of_the_buses_says(make_bench: MakeBench) -> None:
    bench = make_bench(with_wire=False)
    assert [number(bench, index, bus) for index in (0x2320, 0x2321) for bus in (1, 2)] == [0] * 4
    bench.device.buses.count_clients = {"can0": ClientCounts(3, 70_000), "bench": ClientCounts(1, 2)}.__getitem__
    assert [number(bench, 0x2320, bus) for bus in (1, 2)] == [70_000, 2]
    assert [number(bench, 0x2321, bus) for bus in (1, 2)] == [3, 1]


@pytest.mark.parametrize("with_wire", [True, False])
def test_the_bus_has_its_tpdo_where_the_wire_model_runs(make_bench: MakeBench, with_wire: bool) -> None:
    bench = make_bench(with_wire=with_wire)
    if bench.wire is not None:
        bench.wire.corrupt(TPDO, times=2)
    cycles(bench, 20)
    layout = bench_pdos(CELL).bus
    bench.bench_records.clear()
    bench.send_telemetry()
    told = [layout.unpack(r.frame.data) for r in bench.bench_records if r.frame.can_id == layout.cob_id]
    if bench.wire is None:
        assert told == []
    else:
        ((load, errors),) = told
        assert load == pytest.approx(bench.wire.load(1_000_000_000), rel=1e-6)
        assert errors == 2
