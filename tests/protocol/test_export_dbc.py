"""CAN databases of a cell: cantools loads them in strict mode and decodes what was on the bus, in physical units."""

import csv
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest
from cantools.database import load_string
from cantools.database.can import Database, Message

from canarm import Rig
from canarm.commands.export import export
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.bench_objects import bench_pdos
from canarm_protocol.cell.cell_file import load_cell, parse_cell, shipped_cells
from canarm_protocol.cell.export import export_dbc
from canarm_protocol.cell.model import Cell

CELL = load_cell("konkuk1")
JOINTS = ("joint2", "joint3")
LSB_RAD = math.radians(270 / 255)
"""One step of the potentiometer: 270 degrees in 8 bits."""
CURRENT_STEP_A = 1.5 / 255
"""One step of the DAC and of the current sense: 1.5 A (D669) in 8 bits."""
CONVERSION_S = 100e-6
"""A conversion of the ADC0809; its channels are scanned one after the other."""


def databases(cell: Cell) -> tuple[Database, Database]:
    robot, bench = (load_string(text, "dbc", strict=True) for text in export_dbc(cell).values())
    assert isinstance(robot, Database)
    assert isinstance(bench, Database)
    return robot, bench


ROBOT, BENCH = databases(CELL)
EVERY_MESSAGE = [pytest.param(message, id=message.name) for message in (*ROBOT.messages, *BENCH.messages)]


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dbc") / "run"
    with Rig("konkuk1", law="pd", seed=1, out=folder) as rig:
        rig.run(seconds=0.5)
    return folder


def frames(folder: Path) -> Iterator[can.Message]:
    with can.CanutilsLogReader(folder / "can0.log") as log:
        yield from log


def cycles(folder: Path) -> list[dict[str, Any]]:
    """Decoded signals of each SYNC after NMT start: inputs scanned at it, outputs sent in answer to it."""
    found: list[dict[str, Any]] = []
    for message in frames(folder):
        decoded = ROBOT.decode_message(message.arbitration_id, message.data)
        if message.arbitration_id == 0x080:
            found.append({})
        elif found and message.arbitration_id < 0x580:
            found[-1].update(decoded)
    return found


def rows(folder: Path, name: str) -> list[dict[str, float]]:
    with (folder / "signals" / name).open(newline="") as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]


def signed_command_a(signals: dict[str, Any], joint: str) -> float:
    sign = {"off": 0, "clockwise": -1, "counter-clockwise": 1}[str(signals[f"{joint}_direction"])]
    return float(sign * signals[f"{joint}_current_command"])


def test_every_frame_of_a_run_is_in_the_database_and_survives_decoding_and_encoding(run_folder: Path) -> None:
    seen = set()
    for message in frames(run_folder):
        described = ROBOT.get_message_by_frame_id(message.arbitration_id)
        decoded = described.decode(message.data)
        assert described.encode(decoded, strict=True) == message.data
        seen.add(described.name)
    silent = {"dac_EMCY", "latch_EMCY", "adc_EMCY"}
    assert seen == {message.name for message in ROBOT.messages} - silent


def test_decoded_inputs_are_what_the_controller_measured(run_folder: Path) -> None:
    measured = rows(run_folder, "controller.csv")
    pairs = list(zip(measured, cycles(run_folder), strict=False))
    assert len(pairs) == len(measured) > 190
    for row, signals in pairs:
        for place, joint in enumerate(JOINTS):
            speed = signals[f"{joint}_tachometer"]
            assert speed == pytest.approx(row[f"{joint}.measured_rad_s"], abs=1e-8)
            angle = math.radians(signals[f"{joint}_potentiometer"]) - place * CONVERSION_S * speed
            assert angle == pytest.approx(row[f"{joint}.measured_rad"], abs=1e-8)
            assert signals[f"{joint}_current_sense"] == pytest.approx(abs(row[f"{joint}.measured_a"]), abs=1e-8)


def test_decoded_inputs_are_the_true_state_within_quantisation_and_noise(run_folder: Path) -> None:
    for row, signals in zip(rows(run_folder, "robot.csv"), cycles(run_folder), strict=False):
        for joint in JOINTS:
            # A code is rounded down, at most 1 LSB, and the noise is 0.3 LSB: 5 standard deviations are 1.5 LSB.
            angle = math.radians(signals[f"{joint}_potentiometer"])
            assert angle == pytest.approx(row[f"{joint}.true_angle_rad"], abs=2.5 * LSB_RAD)
            speed = signals[f"{joint}_tachometer"]
            assert speed == pytest.approx(row[f"{joint}.true_speed_rad_s"], abs=2.5 * 5.0 / 255 + 0.02)


def test_decoded_outputs_are_what_the_law_asked_for_within_half_a_step(run_folder: Path) -> None:
    for row, signals in zip(rows(run_folder, "controller.csv"), cycles(run_folder), strict=False):
        for joint in JOINTS:
            assert abs(signed_command_a(signals, joint) - row[f"{joint}.command_a"]) <= CURRENT_STEP_A / 2 + 1e-8


def test_decoded_outputs_are_the_amplifiers_command_from_the_next_sync_on(run_folder: Path) -> None:
    truth, decoded = rows(run_folder, "robot.csv"), cycles(run_folder)
    assert any(row["joint2.command_a"] < 0 for row in truth)
    for row, signals in zip(truth[1:200], decoded, strict=False):
        for joint in JOINTS:
            assert signed_command_a(signals, joint) == pytest.approx(row[f"{joint}.command_a"], abs=1e-6)


@pytest.mark.parametrize(
    ("name", "data", "expected"),
    [
        ("adc_TPDO2", "803F0000807F0040", {"joint2_potentiometer": -0.5294118, "joint3_potentiometer": -135.0}),
        ("adc_TPDO2", "803F0000807F0040", {"joint2_tachometer": 2.5, "joint3_tachometer": 0.0098039}),
        ("adc_TPDO3", "807F0000", {"joint2_current_sense": 1.5, "joint3_current_sense": 0.0}),
        ("dac_RPDO2", "0033807F", {"joint2_current_command": 0.6, "joint3_current_command": 1.5}),
        ("latch_RPDO1", "06", {"joint2_direction": "counter-clockwise", "joint3_direction": "clockwise"}),
        ("SYNC", "F0", {"counter": 240}),
        ("TIME", "FF5B26051700", {"milliseconds": 86_400_000 - 1, "days": 23}),
        ("NMT", "0112", {"command": "start", "node_id": "dac"}),
        ("adc_heartbeat", "7F", {"state": "pre-operational"}),
        ("dac_EMCY", "3081110000000000", {"error_code": "life guard or heartbeat", "error_register": 0x11}),
        ("adc_SDO_request", "4001640100000000", {"command": "read", "index": 0x6401, "subindex": 1}),
    ],
)
def test_a_frame_made_by_hand_reads_as_the_data_sheets_say(name: str, data: str, expected: dict[str, Any]) -> None:
    decoded = ROBOT.get_message_by_name(name).decode(bytes.fromhex(data))
    for signal, value in expected.items():
        found = decoded[signal]
        assert found == pytest.approx(value, abs=1e-6) if isinstance(value, float) else found == value


@pytest.mark.parametrize("name", ["adc_TPDO2", "adc_TPDO3", "dac_RPDO2"])
def test_every_code_of_a_converter_goes_there_and_back_within_the_limits(name: str) -> None:
    message = ROBOT.get_message_by_name(name)
    for code in range(256):
        data = (code << 7).to_bytes(2, "little") * (message.length // 2)
        assert message.encode(message.decode(data), strict=True) == data


@pytest.mark.parametrize("message", EVERY_MESSAGE)
def test_every_message_can_be_encoded_and_decoded(message: Message) -> None:
    values: dict[str, Any] = {}
    for signal in message.signals:
        values[signal.name] = 0.25 if signal.is_float else signal.maximum
    data = message.encode(values, strict=True)
    assert len(data) == message.length
    assert message.decode(data, decode_choices=False) == pytest.approx(values)


def test_a_message_of_the_bench_reads_as_its_layout_packs_it() -> None:
    pdos = bench_pdos(CELL)
    truth = BENCH.decode_message(pdos.truth[1].cob_id, pdos.truth[1].pack(0.5, -1.25))
    assert truth == {"joint3_true_angle": 0.5, "joint3_true_speed": -1.25}
    report = BENCH.decode_message(pdos.controller.cob_id, pdos.controller.pack(4096, 3, 2))
    assert report == {"tick": 4096, "late_cycles": 3, "state": "running"}


def test_directions_are_those_of_the_bridge() -> None:
    (signal,) = (
        signal for signal in ROBOT.get_message_by_name("latch_RPDO1").signals if signal.name == "joint2_direction"
    )
    assert signal.choices is not None
    for bits in DirectionBits:
        assert str(signal.choices[bits]) == bits.name.lower().replace("_", "-")


def test_cycle_times_are_attributes() -> None:
    times = {message.name: message.cycle_time for message in ROBOT.messages if message.cycle_time is not None}
    every_cycle = ("SYNC", "dac_RPDO2", "latch_RPDO1", "adc_TPDO2", "adc_TPDO3")
    heartbeats = ("controller_heartbeat", "dac_heartbeat", "latch_heartbeat", "adc_heartbeat")
    assert times == {**dict.fromkeys(every_cycle, 2.5), **dict.fromkeys(heartbeats, 20)}
    assert BENCH.get_message_by_name("bench_TPDO1").cycle_time == 10  # every 4th cycle


def test_senders_and_receivers_are_the_nodes_of_the_cell() -> None:
    assert [node.name for node in ROBOT.nodes] == ["controller", "dac", "latch", "adc"]
    parties = {message.name: (message.senders, message.receivers) for message in ROBOT.messages}
    assert parties["dac_RPDO2"] == (["controller"], {"dac"})
    assert parties["adc_TPDO2"] == (["adc"], {"controller"})
    assert parties["SYNC"] == (["controller"], {"dac", "latch", "adc"})
    assert parties["adc_heartbeat"] == (["adc"], {"controller"})


def test_long_and_reserved_names_become_short_identifiers_that_stay_apart() -> None:
    text = shipped_cells()["konkuk1"]
    for old, new in {
        "joint2": "left-arm-of-the-second-robot-up",
        "joint3": "left-arm-of-the-second-robot-low",
        '"latch"': '"controller"',
        '"dac"': '"card-with-a-long-name-number-001"',
        '"adc"': '"card-with-a-long-name-number-002"',
    }.items():
        text = text.replace(old, new)
    for database in databases(parse_cell(text, "test")):
        names = [message.name for message in database.messages]
        assert len(set(names)) == len(names)
        for message in database.messages:
            signals = [signal.name for signal in message.signals]
            assert len(set(signals)) == len(signals)
            assert all(len(name) <= 32 and name.isidentifier() for name in (message.name, *signals))


def test_without_a_folder_the_robots_bus_goes_to_stdout_or_the_one_that_is_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    robot, bench = export_dbc(CELL).values()
    export("dbc")
    assert capsys.readouterr().out == robot
    export("dbc", bus="bench")
    assert capsys.readouterr().out == bench


def test_into_a_folder_go_both_buses_or_the_one_that_is_named(tmp_path: Path) -> None:
    export("dbc", out=tmp_path / "both")
    assert {path.name for path in (tmp_path / "both").iterdir()} == {"konkuk1_can0.dbc", "konkuk1_bench.dbc"}
    export("dbc", bus="bench", out=tmp_path / "one")
    assert [path.name for path in (tmp_path / "one").iterdir()] == ["konkuk1_bench.dbc"]
