"""`canarm monitor` as a process: lines of text on an emulator's bus and on other buses, exit status, one clear line."""

import shlex
import shutil
import signal
import sys

import can
import pytest

from canarm.cli import run as canarm_here
from canarm_protocol.canopen.dictionary import eds_text
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.export import export_dbc
from canarm_protocol.transport import python_can_port
from tests.tui.test_dashboard_terminal import Terminal, wait_for


def test_frames_of_an_emulator_are_lines_that_say_what_they_mean_until_ctrl_c(canarm):
    emulator = canarm.emulator("sync")
    address = f"127.0.0.1:{emulator.port}"
    monitor = canarm("monitor", "--connect", address, "--filter", "-sync")
    monitor.wait_for("listening on .*-i canarm -c can0")
    jog = canarm("jog", "--connect", address, "--clock", "sync", "--do", "current joint2 0.4; step; read")
    assert jog.wait() == 0, jog
    monitor.wait_for(r"^\(\d+\.\d{6}\) 712#00 +heartbeat of dac: boot-up$")
    monitor.wait_for(r" 312#00220000 +RPDO2 of dac: joint2\.current_command 0\.4000 A, joint3")
    monitor.wait_for(r" 294#[0-9A-F]{16} +TPDO2 of adc: joint2\.potentiometer .* deg, .* rad/s")
    monitor.wait_for(r" SDO of dac: 0x1000:00 Device type = 524689 ")
    monitor.send(signal.SIGINT)
    assert monitor.wait() == 0, monitor
    assert not any(" 080#" in line for line in monitor.stdout)


def test_it_ends_when_nobody_reads_any_more(canarm):
    """As candump does in `candump can0 | head`: the shell waits for both."""
    emulator = canarm.emulator("sync")
    address = f"127.0.0.1:{emulator.port}"
    words = shlex.join([sys.executable, "-m", "canarm", "monitor", "--connect", address])
    pipe = canarm.run("sh", "-c", f"{words} | head -n 1")
    pipe.wait_for("listening on")
    jog = canarm("jog", "--connect", address, "--clock", "sync", "--do", "read")
    assert jog.wait() == 0, jog
    assert pipe.wait() == 0, pipe
    assert len(pipe.stdout) == 1
    assert "Traceback" not in str(pipe)


@pytest.mark.skipif(shutil.which("tmux") is None, reason="tmux is not installed")
def test_in_a_terminal_it_is_a_screen_of_a_real_emulators_bus(canarm, tmp_path):
    emulator = canarm.emulator("sync")
    address = f"127.0.0.1:{emulator.port}"
    terminal = Terminal(tmp_path / "tmux", 120, 35, [sys.executable, "-m", "canarm", "monitor", "--connect", address])
    try:
        wait_for(terminal, lambda: None, "○ no frame since this view was opened")
        jog = canarm("jog", "--connect", address, "--clock", "sync", "--do", "current joint2 0.4; step 4; read")
        assert jog.wait() == 0, jog
        wait_for(terminal, lambda: None, "RPDO2 of dac joint2.current_command 0.4000 A", "heartbeat of adc")
        terminal.press("q")
        assert wait_for(terminal, lambda: None, "exit status").strip() == "exit status 0"
    finally:
        terminal.close()


@pytest.fixture
def virtual_bus():
    """python-can's own bus within a process."""
    with can.Bus(interface="virtual", channel="foreign") as bus:
        yield bus


def test_any_python_can_bus_is_decoded_by_eds_and_dbc_files(virtual_bus, tmp_path, capsys, monkeypatch):
    (tmp_path / "adc.eds").write_text(eds_text("adc0809"), encoding="ascii")
    (tmp_path / "cell.dbc").write_text(next(iter(export_dbc(load_cell("konkuk1")).values())), encoding="ascii")
    monkeypatch.chdir(tmp_path)
    sent = [(0x285, "00490040803F803F"), (0x605, "4018100200000000"), (0x312, "00220000"), (0x1FF, "")]

    class Filled(python_can_port.PythonCanPort):
        def receive(self, timeout_s):
            while sent:
                can_id, data = sent.pop(0)
                virtual_bus.send(can.Message(arbitration_id=can_id, data=bytes.fromhex(data), is_extended_id=False))
            return super().receive(timeout_s)

    monkeypatch.setattr(python_can_port, "PythonCanPort", Filled)
    words = ["monitor", "-i", "virtual", "-c", "foreign", "--eds", "0x05=adc.eds", "--dbc", "cell.dbc"]
    assert canarm_here([*words, "--seconds", "0.3"]) == 0
    told = capsys.readouterr()
    lines = [line.split(") ", 1)[1] for line in told.out.splitlines()]
    assert lines[0].startswith("285#00490040803F803F TPDO2 of ADC0809 card 0x05: Analogue input 1 18688")
    assert lines[1].endswith("SDO to ADC0809 card 0x05: read 0x1018:02 Identity object.Product code")
    assert "dac_RPDO2: joint2_current_command 0.4" in lines[2]
    assert "listening on -i virtual -c foreign" in told.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["-i", "nonsense"], "python-can knows no such interface"),
        (["-c", "can0"], "of which bus? name its interface, such as -i socketcan"),
        (["--eds", "none.eds"], "none.eds: No such file or directory; name an EDS or DCF file"),
        (["--eds", "0x80=none.eds"], "write NODE=FILE with a node-ID from 1 to 127, such as 0x12=drive.eds"),
        (["--eds", "x=none.eds"], "write NODE=FILE"),
        (["--dbc", "none.dbc"], "none.dbc: No such file or directory; name a DBC file"),
        (["--dbc", ""], "--dbc: the name of the file is empty"),
        (["--cell", "none"], "none"),
        (["--seconds", "-1"], "must be a number of seconds above 0"),
        (["--connect", "nowhere"], "write HOST:PORT"),
    ],
)
def test_a_wrong_command_line_is_one_clear_line_and_status_2(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert canarm_here(["monitor", *words]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert len(told.splitlines()) == 1


def test_a_bus_that_is_not_there_is_one_clear_line_and_status_1(capsys):
    assert canarm_here(["monitor", "--connect", "127.0.0.1:1", "--seconds", "1"]) == 1
    told = capsys.readouterr().err
    assert "nobody listens there; start one with: canarm emulator" in told
    assert len(told.splitlines()) == 1
