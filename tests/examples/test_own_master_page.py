"""docs/own-master.md and examples/by_hand.md say what is: tables against the cell, frames against a real emulator."""

import math
import re
import struct

import can
import pytest

from canarm.cli import run
from canarm_protocol.cell.bench_objects import bench_pdos, sdo_channel
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell, Command, Quantity
from canarm_protocol.cell.sensing import joint_sensors
from canarm_protocol.cell.wiring import WiredSignal, card_nodes, command_scale, wired_signals
from canarm_protocol.transport.port import open_port
from canarm_protocol.transport.sdo_session import SdoSession

ANSWER_S = 20.0
NOISY = {0x294, 0x394}
"""Process data of sensors: the page shows one sample."""
MOST_NOISE_LSB = 4
"""Thirteen standard deviations of the noise, 0.3 LSB."""
CYCLES = 1600
"""576 of them are scored: the first 1024 are left out."""
INPUT = b"\x4b\x01\x64\x01"
"""SDO answer: 0x6401:1, two bytes."""


def page(root, name: str) -> str:
    return (root / name).read_text(encoding="utf-8")


def meaning(cell: Cell, signal: WiredSignal) -> str:
    if signal.leaf == Command.DIRECTION:
        return "00 off, 01 clockwise, 10 counter-clockwise (positive)"
    quantity, sensors = signal.quantity, joint_sensors(cell)[signal.joint]
    wired = None if quantity is None else sensors.measuring(quantity)
    scale = command_scale(cell, signal.joint) if wired is None else wired.scale
    unit = {Quantity.POSITION: "rad", Quantity.VELOCITY: "rad/s"}.get(quantity, "A") if quantity else "A"
    code = f"(code − {scale.zero:g})" if scale.zero else "code"
    return f"{code} × {scale.step:.4g} {unit}"


def process_data(cell: Cell) -> list[str]:
    """The rows of the page's table."""
    rows = []
    for node in card_nodes(cell):
        for layout in (*node.rpdos, *node.tpdos):
            for signal in wired_signals(cell, node, layout):
                last_bit = signal.start_bit + signal.bit_length - 1
                what = meaning(cell, signal)
                rows.append(
                    f"| `0x{layout.cob_id:03X}` | {layout.kind.upper()}{layout.number} of {node.card.name}, "
                    f"node 0x{node.card.node_id:02X} | {signal.start_bit}–{last_bit} | "
                    f"{cell.joint_names[signal.joint]}.{signal.leaf} | {what} |"
                )
    return rows


def test_the_page_shows_the_nodes_as_canarm_check_does(root, capsys):
    assert run(["check"]) == 0
    cards = [line for line in capsys.readouterr().out.splitlines() if re.match(r"card |  [RT]PDO", line)]
    [shown] = re.findall(r"\$ canarm check\n(.*?)```", page(root, "docs/own-master.md"), re.DOTALL)
    assert shown.splitlines() == cards


def test_the_pages_table_of_process_data_is_the_cells(root):
    rows = [line for line in page(root, "docs/own-master.md").splitlines() if re.match(r"\| `0x\w+` \| [RT]PDO", line)]
    assert rows == process_data(load_cell("konkuk1"))


def test_the_pages_numbers_of_the_bus_are_the_cells(root):
    cell, text = load_cell("konkuk1"), page(root, "docs/own-master.md")
    bus = cell.bus
    assert f"0x1016:1 = 0x{bus.controller_node_id << 16 | bus.heartbeat_timeout_ms:08X}" in text
    assert f"0x1017 = {bus.heartbeat_ms}," in text
    assert f"Every {bus.cycle_us / 1000:g} ms on the wall clock" in text
    assert f"node 0x{bus.bench_node_id:02X} on the bench bus" in text
    layouts = zip(cell.joint_names, bench_pdos(cell).reference, strict=True)
    references = [f"| `0x{layout.cob_id:03X}` | {name} |" for name, layout in layouts]
    assert re.findall(r"^\| `0x24.*$", text, re.MULTILINE) == references


def test_a_reference_that_is_reported_as_the_page_says_is_scored(emulator, root):
    """Joint 2 rests at 20 degrees; the page's own lines report ten steps of 270/255 degrees more than that."""
    open_bench, report = re.findall(r"```python\n(.*?)\n(.*?)\n```", page(root, "docs/own-master.md"), re.DOTALL)[0]
    names = {"can": can, "struct": struct, "reference_rad": math.radians(20.0 + 10 * 270 / 255)}
    exec(open_bench.replace("29536", str(emulator)), names)
    with names["bench"], can.Bus(interface="canarm", channel="can0", host="127.0.0.1", port=emulator) as robot:
        robot.send(message(0x000, b"\x01\x00"))
        for cycle in range(CYCLES):
            robot.send(message(0x080, b""))
            await_frame(robot, 0x100)
            exec(report, {**names, "cycle": cycle})
        with open_port("canarm", "bench", host="127.0.0.1", port=emulator) as port:
            session = SdoSession(port, *sdo_channel(0x70, 3), limit_s=ANSWER_S)
            [rms_lsb], [max_lsb] = (struct.unpack("<f", session.upload(index, 1)) for index in (0x2200, 0x2201))
    assert (rms_lsb, max_lsb) == pytest.approx((10.0, 10.0), rel=1e-4)


def test_the_pages_session_at_the_prompt_is_what_canarm_jog_says(emulator, run_python, root):
    [session] = re.findall(r"\$ canarm jog --clock sync\n(.*?)```", page(root, "docs/own-master.md"), re.DOTALL)
    typed = re.findall(r"^canarm> (.*)$", session, re.MULTILINE)
    shown = [line for line in session.splitlines() if not line.startswith("canarm> ")]
    arguments = ("--clock", "sync", "--connect", f"127.0.0.1:{emulator}", "--do", "; ".join(typed))
    done = run_python("-m", "canarm", "jog", *arguments)
    assert (done.returncode, done.stderr) == (0, "")
    lines = [re.sub(r"-?\d+\.\d deg", "DEG", line) for line in done.stdout.splitlines()]
    assert lines == [re.sub(r"-?\d+\.\d deg", "DEG", line) for line in shown]


def test_the_frames_of_the_page_by_hand_are_answered_as_it_shows(emulator, root):
    text = page(root, "examples/by_hand.md")
    exchanges = re.findall(r"^\$ cansend vcan0 (\w+)#(\w*)\n((?:  vcan0 .*\n)*)", text, re.MULTILINE)
    assert len(exchanges) > 12
    with can.Bus(interface="canarm", channel="can0", host="127.0.0.1", port=emulator) as robot:
        for sent_id, sent, lines in exchanges:
            robot.send(message(int(sent_id, 16), bytes.fromhex(sent)))
            for can_id, size, data in re.findall(r"vcan0  (\w+)   \[(\d)\]  (.*)", lines):
                answer = await_frame(robot, int(can_id, 16))
                shown = bytes.fromhex(data)
                assert len(shown) == int(size) == answer.dlc
                if answer.arbitration_id in NOISY:
                    difference = zip(codes(answer.data), codes(shown), strict=True)
                    assert all(abs(is_ - was) <= MOST_NOISE_LSB for is_, was in difference), (sent, lines)
                elif shown.startswith(INPUT):
                    assert abs(codes(answer.data[4:6])[0] - codes(shown[4:6])[0]) <= MOST_NOISE_LSB
                else:
                    assert bytes(answer.data) == shown, (sent, lines)


def codes(data: bytes) -> list[int]:
    return [value >> 7 for value in struct.unpack(f"<{len(data) // 2}h", data)]


def message(can_id: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def await_frame(bus: can.BusABC, can_id: int) -> can.Message:
    while (received := bus.recv(ANSWER_S)) is not None:
        if received.arbitration_id == can_id:
            return received
    raise AssertionError(f"no frame 0x{can_id:03X}")
