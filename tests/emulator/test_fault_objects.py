"""Faults by SDO on the bench node: what is written is done, what became of it is read back, clients do not meet."""

import io
import json
import struct
import zlib
from typing import Any

import canopen
import pytest

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.serving.recording import Recorder
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.canopen.sdo import AbortCode, SdoAborted, download, upload
from canarm_protocol.cell import bench_objects as objects
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.export import export_eds
from canarm_protocol.cell.output_frames import OutputFrames
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.runs.run_folder import create_run_folder
from tests.emulator.bench_sdo import NODE, Client

CELL = load_cell("konkuk1")
SECOND = 1_000_000_000
STUCK = """
[[set]]
name = "{name}"
duration = 0.01

[[set.fault]]
tap = "joint2.tachometer"
fault = "stuck"
value = 5.0
"""


def run_cycles(bench: FaultBench, count: int, codes: tuple[int, int] = (0, 0)) -> None:
    if bench.cycle < 0:
        bench.receive(nmt_frame(NmtCommand.START))
    for _ in range(count):
        for cob_id, data, *_ in OutputFrames(CELL, card_nodes(CELL)).frames(codes, (2, 2)):
            bench.receive(Frame(cob_id, data.ljust(8, b"\0")))  # cards that nobody has configured map all channels
        bench.receive(sync_frame(None))


# What is written is done


def test_a_set_is_done_and_its_result_is_read_back(bench: FaultBench, client: Client) -> None:
    run_cycles(bench, 3)
    client.inject(STUCK.format(name="dies"))
    assert client.text(objects.FAULT_RESULT) == "accepted 'dies'"
    assert client.status()["sets"] == [{"set": "dies", "state": "waiting", "activations": 0, "duration_s": 0.01}]
    run_cycles(bench, 1)
    assert client.status() == {
        "time_ns": bench.time_ns,
        "cycle": 3,
        "running": True,
        "begin_ns": 0,
        "begun": 1,
        "sets": [{"set": "dies", "state": "active", "activations": 1, "duration_s": 0.01}],
        "active": [{"set": "dies", "tap": "joint2.tachometer", "fault": "stuck"}],
        "stops": [],
    }
    assert client.read(objects.ACTIVE_FAULTS) == b"\1"
    run_cycles(bench, 4)  # 10 ms
    assert client.status()["active"] == []
    assert client.read(objects.ACTIVE_FAULTS) == b"\0"
    assert client.read(objects.BEGUN_FAULTS) == b"\1\0\0\0"


def test_the_emergency_stop_is_remembered_with_its_time_and_the_beginning_of_the_run(
    bench: FaultBench, client: Client
) -> None:
    assert client.status()["begin_ns"] is None
    run_cycles(bench, 3)
    for value in (1, 1, 0):
        client.run(download(objects.EMERGENCY_STOP, 0, bytes((value,))))
    bench.device.is_stopped = True
    bench.power_cycle()
    stops = client.status()["stops"]
    assert [(each["event"], each["state"], each["cycle"]) for each in stops[:2]] == [
        ("emergency-stop", "on", 2),
        ("emergency-stop", "off", 2),
    ]
    assert all(5_000_000 <= each["time_ns"] < 7_500_000 for each in stops[:2]), "between the third SYNC and the next"
    assert stops[2]["state"] == "off", "so does the robot's power-on"
    assert client.status()["begin_ns"] is None


def test_events_tell_time_cycle_and_place_of_beginnings_and_ends(bench: FaultBench, client: Client) -> None:
    assert client.text(objects.FAULT_EVENTS) == "\n"
    run_cycles(bench, 3)
    client.inject(STUCK.format(name="dies"))
    run_cycles(bench, 6)
    begins, ends = [json.loads(line) for line in client.text(objects.FAULT_EVENTS).splitlines()]
    where = {"set": "dies", "tap": "joint2.tachometer", "fault": "stuck"}
    assert begins == {"time_ns": 7_500_000, "event": "fault-begins", **where, "cycle": 3}
    assert ends == {"time_ns": 17_500_000, "event": "fault-ends", **where, "cycle": 7}


def test_no_more_events_are_kept_than_the_last_hundred(bench: FaultBench, client: Client) -> None:
    fault = '[[set.fault]]\ntap = "joint2.tachometer"\nfault = "offset"\n'
    client.inject('[[set]]\nname = "many"\n' + 60 * fault)
    client.inject('clear = ""')
    events = [json.loads(line)["event"] for line in client.text(objects.FAULT_EVENTS).splitlines()]
    assert events == 40 * ["fault-begins"] + 60 * ["fault-ends"]
    assert client.status()["begun"] == 60


def test_sets_are_cleared_and_triggered_by_texts_of_their_own(bench: FaultBench, client: Client) -> None:
    client.inject(STUCK.format(name="by hand").replace("duration = 0.01", "manual = true"))
    run_cycles(bench, 2)
    assert client.status()["active"] == []
    client.inject('trigger = "by hand"')
    assert client.text(objects.FAULT_RESULT) == "triggered 'by hand'"
    run_cycles(bench, 1)
    assert len(client.status()["active"]) == 1
    client.inject('clear = "by hand"')
    assert client.text(objects.FAULT_RESULT) == "cleared 1"
    assert client.status()["sets"] == client.status()["active"] == []


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (STUCK.format(name="x").replace("tachometer", "tachometr"), "set 'x', fault 1: no tap 'joint2.tachometr'; did"),
        ("[[set]\n", "fault set: not valid TOML: "),
        ("# nothing", 'fault set: holds no set; to clear all, write clear = ""'),
        ("# " + 100_000 * "x", "fault set: 100002 characters; must have at most 100000"),
        ('trigger = "ü"', "no set '\\xfc' to trigger; there are none"),
    ],
)
def test_what_is_refused_is_aborted_and_the_reason_can_be_read(client: Client, text: str, reason: str) -> None:
    with pytest.raises(SdoAborted) as caught:
        client.inject(text)
    assert caught.value.code == AbortCode.INVALID_VALUE
    assert client.text(objects.FAULT_RESULT).startswith(f"refused: {reason}")
    assert client.status()["sets"] == []


def test_a_byte_order_mark_is_taken(client: Client) -> None:
    client.run(download(objects.FAULT_SET, 0, b"\xef\xbb\xbf" + STUCK.format(name="x").encode()))
    assert client.text(objects.FAULT_RESULT) == "accepted 'x'"


def test_the_hint_at_a_tap_is_a_sentence_of_its_own(client: Client) -> None:
    with pytest.raises(SdoAborted):
        client.inject(STUCK.format(name="x").replace("joint2.tachometer", "JOINT2.TACHO"))
    assert client.text(objects.FAULT_RESULT).endswith("did you mean 'joint2.tachometer'? See `canarm fault list`")


def test_what_is_no_utf_8_is_refused(client: Client) -> None:
    with pytest.raises(SdoAborted):
        client.run(download(objects.FAULT_SET, 0, b"\xff" * 20))
    assert client.text(objects.FAULT_RESULT).startswith("refused: fault set: is not UTF-8: ")


class Stumbling:
    """Carries out no script."""

    def inject(self, script: object) -> str:
        raise RecursionError("maximum recursion depth exceeded")

    def plain_sets(self) -> list[dict[str, Any]]:
        return []

    def plain_catalogue(self) -> list[dict[str, Any]]:
        return []

    def load(self) -> None:
        pass


def test_a_text_that_nobody_foresaw_is_refused_and_the_bench_goes_on(bench: FaultBench, client: Client) -> None:
    bench.device.faults.attach(Stumbling())
    with pytest.raises(SdoAborted):
        client.inject(STUCK.format(name="x"))
    assert client.text(objects.FAULT_RESULT).startswith("refused: fault set: cannot be done (RecursionError)")
    assert client.status()["sets"] == []


def test_a_condition_nested_in_itself_without_end_is_refused_and_the_bench_goes_on(client: Client) -> None:
    with pytest.raises(SdoAborted):
        client.inject(
            f'[[set]]\nwhen = "({"~" * 380}f)(1) > 1"\n[[set.fault]]\ntap = "joint2.tachometer"\nfault = "stuck"'
        )
    assert "nested too deep" in client.text(objects.FAULT_RESULT)
    assert client.status()["sets"] == []


def test_100_kb_are_taken_and_more_than_there_is_room_for_is_refused_at_once(client: Client) -> None:
    text = STUCK.format(name="x")
    client.inject(text + "#" * (100_000 - len(text)))
    assert client.text(objects.FAULT_RESULT) == "accepted 'x'"
    announcement = struct.pack("<BHBI", 0x21, objects.FAULT_SET, 0, 0xFFFF_FFFF)
    refusal = client.request(announcement)
    assert refusal == struct.pack("<BHBI", 0x80, objects.FAULT_SET, 0, AbortCode.OUT_OF_MEMORY)


def test_the_packed_catalogue_says_the_same_in_a_tenth_of_the_bytes(client: Client) -> None:
    plain, packed = client.read(objects.FAULT_CATALOGUE), client.read(objects.PACKED_CATALOGUE)
    assert zlib.decompress(packed) == plain
    assert 10 * len(packed) < len(plain)


@pytest.mark.slow
def test_packed_events_say_the_same_in_a_fifth_of_the_bytes(bench: FaultBench, client: Client) -> None:
    assert zlib.decompress(client.read(objects.PACKED_EVENTS)) == client.read(objects.FAULT_EVENTS)
    client.inject(STUCK.format(name="again").replace("duration = 0.01", "duration = 0.0025\nrepeat = 100"))
    run_cycles(bench, 200)
    plain, packed = client.read(objects.FAULT_EVENTS), client.read(objects.PACKED_EVENTS)
    assert zlib.decompress(packed) == plain
    assert len(plain.splitlines()) == objects.MOST_EVENTS
    assert 5 * len(packed) < len(plain)


def test_the_catalogue_has_every_tap_with_faults_parameters_and_limits(client: Client) -> None:
    taps = {each["tap"]: each for each in json.loads(client.text(objects.FAULT_CATALOGUE))}
    assert {"joint2.dac.code", "joint3.link", "can0.rx", "node.0x12", "bench.clock"} <= set(taps)
    stuck = next(each for each in taps["joint2.tachometer"]["faults"] if each["fault"] == "stuck")
    value = stuck["parameters"][0]
    assert (value["name"], value["unit"], value["minimum"], value["maximum"]) == ("value", "V", 0.0, 5.0)


def test_reading_makes_no_fault_engine_that_would_cost_something_in_every_cycle(
    bench: FaultBench, client: Client
) -> None:
    for index in range(objects.FAULT_RESULT, objects.BEGUN_FAULTS + 1):
        client.read(index)
    assert bench._faults is None


def test_the_fault_set_itself_cannot_be_read(client: Client) -> None:
    with pytest.raises(SdoAborted) as caught:
        client.read(objects.FAULT_SET)
    assert caught.value.code == AbortCode.WRITE_ONLY


# Emergency stop


def test_the_emergency_stop_takes_the_current_from_a_motor_that_is_driven_and_gives_it_back(
    bench: FaultBench, client: Client
) -> None:
    told: list[bool] = []
    bench.device.on_emergency_stop = told.append

    def current_a() -> float:
        return abs(bench.world.state()[0].current_a)

    run_cycles(bench, 12, codes=(100, 0))
    assert current_a() == pytest.approx(1.5 * 100 / 255, rel=0.02)  # D669: 1.5 A at full scale
    client.run(download(objects.EMERGENCY_STOP, 0, b"\1"))
    assert client.read(objects.EMERGENCY_STOP) == b"\1"
    run_cycles(bench, 12, codes=(100, 0))
    assert current_a() < 1e-3
    client.run(download(objects.EMERGENCY_STOP, 0, b"\1"))
    client.run(download(objects.EMERGENCY_STOP, 0, b"\0"))
    run_cycles(bench, 12, codes=(100, 0))
    assert current_a() > 0.3
    assert told == [True, False]
    with pytest.raises(SdoAborted) as caught:
        client.run(download(objects.EMERGENCY_STOP, 0, b"\2"))
    assert caught.value.code == AbortCode.TOO_HIGH


def test_telemetry_shows_active_faults_and_the_emergency_stop(bench: FaultBench, client: Client) -> None:
    layout = objects.bench_pdos(CELL).faults
    client.inject(STUCK.format(name="x"))
    client.run(download(objects.EMERGENCY_STOP, 0, b"\1"))
    bench.bench_records.clear()
    bench.send_telemetry()
    sent = [each.frame.data for each in bench.bench_records if each.frame.can_id == layout.cob_id]
    assert [layout.unpack(data) for data in sent] == [(1, 1, 1, 0)]


# Several clients


def test_each_channel_has_results_of_its_own(bench: FaultBench) -> None:
    first, second = Client(bench, 2, 1), Client(bench, 3, 2)
    first.inject(STUCK.format(name="a"))
    with pytest.raises(SdoAborted):
        second.inject("[[set]\n")
    assert first.text(objects.FAULT_RESULT) == "accepted 'a'"
    assert second.text(objects.FAULT_RESULT).startswith("refused: ")


def test_half_a_transfer_of_a_slow_client_holds_up_nobody_and_can_go_on_later(bench: FaultBench) -> None:
    slow, quick = Client(bench, 2, 1), Client(bench, 3, 2)
    transfer = download(objects.FAULT_SET, 0, STUCK.format(name="slow").encode())
    request = next(transfer)
    for _ in range(3):
        answer = slow.request(request)
        assert answer is not None
        request = transfer.send(answer)
    quick.inject(STUCK.format(name="quick"))
    assert [each["set"] for each in quick.status()["sets"]] == ["quick"]
    slow.go_on(transfer, request)
    assert [each["set"] for each in quick.status()["sets"]] == ["quick", "slow"]


def test_a_channel_is_claimed_by_one_client_and_refused_to_the_next(bench: FaultBench) -> None:
    first, second = Client(bench, 0, 1), Client(bench, 0, 2)
    assert first.claim(4, 111) == 0
    assert second.claim(4, 222) == AbortCode.DEVICE_STATE
    assert second.claim(5, 222) == 0
    owners = [int.from_bytes(first.read(objects.CHANNEL_OWNER, channel), "little") for channel in (4, 5, 6)]
    assert owners == [111, 222, 0]


def test_a_stranger_on_a_claimed_channel_is_not_answered_and_breaks_no_transfer(bench: FaultBench) -> None:
    owner, stranger = Client(bench, 0, 1), Client(bench, 4, 2)
    owner.claim(4, 111)
    transfer = upload(objects.FAULT_CATALOGUE, 0)
    answer = owner.request(next(transfer))
    assert answer is not None
    request = transfer.send(answer)
    assert stranger.request(next(upload(objects.CYCLE, 0))) is None
    assert bench.device.channels.ignored == 1
    answer = owner.request(request)
    assert answer is not None
    assert answer[0] & 0xE0 == 0x00  # the next segment


def test_a_channel_is_free_when_given_back_when_its_client_leaves_and_after_ten_silent_seconds(
    bench: FaultBench,
) -> None:
    first, second, channels = Client(bench, 0, 1), Client(bench, 0, 2), bench.device.channels
    first.claim(4, 111)
    first.run(download(objects.CHANNEL_OWNER, 4, bytes(4)))
    assert second.claim(4, 222) == 0
    channels.leave(2)
    assert first.claim(4, 111) == 0
    channels.now_ns += 6 * SECOND
    first.read(objects.CYCLE)
    channels.now_ns += 6 * SECOND
    assert second.claim(4, 222) == AbortCode.DEVICE_STATE
    channels.now_ns += 4 * SECOND
    assert second.claim(4, 222) == 0
    assert first.request(next(upload(objects.CYCLE, 0))) is None
    assert first.claim(4, 111) == AbortCode.DEVICE_STATE


def test_a_client_may_claim_its_channel_anew_and_has_one_at_most(bench: FaultBench) -> None:
    client = Client(bench, 0, 1)
    assert [client.claim(4, 111), client.claim(4, 111), client.claim(5, 111)] == [0, 0, 0]
    assert [bench.device.channels.owner(channel) for channel in (4, 5)] == [0, 111]


def test_a_channel_that_somebody_uses_without_a_claim_is_not_taken_from_under_him(bench: FaultBench) -> None:
    channels = bench.device.channels
    Client(bench, 4, 1).read(objects.CYCLE)
    claimant = Client(bench, 0, 2)
    assert claimant.claim(4, 222) == AbortCode.DEVICE_STATE
    channels.now_ns += 10 * SECOND
    assert claimant.claim(4, 222) == 0


def test_the_default_channel_the_controllers_and_that_for_claims_cannot_be_claimed(bench: FaultBench) -> None:
    for channel in (1, objects.CLAIM_CHANNEL):
        assert Client(bench, 0, 1).claim(channel, 111) == AbortCode.READ_ONLY


def test_a_claim_over_another_channel_than_that_for_claims_is_refused(bench: FaultBench) -> None:
    with pytest.raises(SdoAborted) as caught:
        Client(bench, 0, 1).run(download(objects.CHANNEL_OWNER, 4, b"\1\0\0\0"))
    assert caught.value.code == AbortCode.DEVICE_STATE


def test_a_new_owner_does_not_read_the_result_of_the_one_before(bench: FaultBench) -> None:
    first, second = Client(bench, 0, 1), Client(bench, 0, 2)
    first.claim(4, 111)
    first.inject(STUCK.format(name="a"))
    bench.device.channels.leave(1)
    second.claim(4, 222)
    assert second.text(objects.FAULT_RESULT) == "nothing was written on this channel yet"


# Other people's tools


class Link(canopen.Network):
    """A network without a bus: what the library sends is answered before `send_message` returns."""

    def __init__(self, bench: FaultBench) -> None:
        super().__init__()
        self._bench = bench

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        before = len(self._bench.bench_records)
        self._bench.receive_bench(Frame(can_id, bytes(data), is_remote=remote), self)
        for time_ns, frame, origin in self._bench.bench_records[before:]:
            if origin is None:
                self.notify(frame.can_id, bytearray(frame.data), time_ns * 1e-9)


def test_python_canopen_injects_by_its_stock_client_on_the_default_channel(bench: FaultBench) -> None:
    eds = io.StringIO(export_eds(CELL)["konkuk1_bench.eds"])
    eds.name = "konkuk1_bench.eds"
    node = Link(bench).add_node(NODE, eds)
    node.sdo["Fault set to be done, as TOML"].raw = STUCK.format(name="by canopen").encode()
    assert node.sdo[0x2401].raw == "accepted 'by canopen'"
    assert json.loads(node.sdo[0x2402].raw)["active"][0]["tap"] == "joint2.tachometer"
    with pytest.raises(canopen.SdoAbortedError) as caught:
        node.sdo[0x2400].raw = b"nonsense"
    assert caught.value.code == AbortCode.INVALID_VALUE
    node.sdo[0x2410].raw = 1
    assert node.sdo[0x2410].raw == 1
    assert len(json.loads(node.sdo[0x2403].raw)) > 30


# The record


def test_a_run_folder_has_beginnings_and_ends_with_their_times_and_cycle(bench: FaultBench, tmp_path: Any) -> None:
    recorder = Recorder(create_run_folder(tmp_path / "run"), CELL)
    bench.device.faults.on_event = recorder.fault
    bench.on_cycle = recorder.cycle
    bench.advance(1_000_000)
    run_cycles(bench, 2)
    Client(bench, 0, 1).inject(STUCK.format(name="dies"))
    run_cycles(bench, 6)
    recorder.event(bench.time_ns, "something")
    recorder.close()
    events = [json.loads(line) for line in (tmp_path / "run" / "events.jsonl").read_text().splitlines()]
    assert [(each["event"], each["cycle"]) for each in events] == [
        ("fault-begins", 2),
        ("fault-ends", 6),
        ("something", 7),
    ]
    assert (events[0]["time_s"], events[0]["power_on_s"]) == (0.005, 0.006)
    assert events[0]["tap"] == "joint2.tachometer"
