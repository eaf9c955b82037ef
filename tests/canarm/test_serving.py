"""What the emulator says about who reaches it, how to attach, and whether its wire can carry the cell."""

import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from canarm import serving
from canarm.options import NamedBus
from canarm_protocol.transport.hub_client import HubClientBus
from canarm_protocol.transport.port import open_port
from canarm_protocol.transport.sdo_session import SdoSession

SLOW = {"bitrate = 1_000_000": "bitrate = 125_000"}
LOCAL = ("127.0.0.1", 29536)


def test_each_address_that_others_reach_is_named_with_what_it_opens():
    lines = serving.exposure_lines(("0.0.0.0", 29536), ("0.0.0.0", 7001), {"can0": None, "bench": None})
    assert lines == [
        "0.0.0.0:29536 is open to other machines: "
        "whoever reaches it can drive the robot, set faults and read everything",
        "0.0.0.0:7001 (slcan) is open to other machines: whoever reaches it can drive the robot and read its bus",
    ]
    assert serving.exposure_lines(LOCAL, ("127.0.0.1", 7001), {"can0": None, "bench": None}) == []
    assert serving.exposure_lines(("::1", 29536), None, {}) == []
    (only,) = serving.exposure_lines(LOCAL, ("192.0.2.7", 7001), {})
    assert only.startswith("192.0.2.7:7001 (slcan)")


def test_multicast_is_said_to_reach_the_network_where_it_was_allowed_to():
    group = NamedBus("udp_multicast", "239.74.163.2", {}).allowing_remote()
    (line,) = serving.exposure_lines(LOCAL, None, {"can0": group, "bench": None})
    assert "carries can0 to the network" in line
    assert "drive the robot" in line
    (line,) = serving.exposure_lines(LOCAL, None, {"can0": None, "bench": group})
    assert "set faults" in line
    assert serving.exposure_lines(LOCAL, None, {"can0": NamedBus("udp_multicast", None, {"hop_limit": 1})}) == []
    assert NamedBus("socketcan", "vcan0", {}).allowing_remote() == NamedBus("socketcan", "vcan0", {})


def test_attach_flags_name_an_address_that_a_client_can_use():
    assert "host=127.0.0.1 port=7" in serving.attach_flags("can0", "127.0.0.1", 7)
    host = serving.reachable_host("0.0.0.0")
    assert host != "0.0.0.0"
    assert socket.getaddrinfo(host, 7)


def test_an_adapter_that_is_open_to_the_network_is_announced(canarm):
    emulator = canarm.emulator("sync", "--slcan", "socket://0.0.0.0:0", "--allow-remote")
    emulator.wait_for(r"0\.0\.0\.0:\d+ \(slcan\) is open to other machines: whoever reaches it can drive the robot")


@pytest.mark.parametrize("command", ["emulator", "controller", pytest.param("demo", marks=pytest.mark.slow)])
def test_a_cell_whose_traffic_does_not_fit_is_warned_of_once_and_runs(canarm, command):
    cell = canarm.write_cell("slow.toml", SLOW)
    arguments = {
        "emulator": ["--wire", "--serve", "127.0.0.1:0", "--seconds", "0.1"],
        "controller": ["--connect", "127.0.0.1:1"],
        "demo": ["--clock", "sync", "--seconds", "0.1", "--no-tui"],
    }[command]
    process = canarm(command, "--cell", cell, *arguments)
    assert process.wait() == (1 if command == "controller" else 0), process
    warnings = [line for line in process.stderr if "does not fit" in line]
    assert len(warnings) == 1
    assert f"canarm check --cell {cell} has the arithmetic" in warnings[0]


def test_a_run_with_the_wire_model_ends_with_a_line_about_it(canarm):
    emulator = canarm.emulator("wall", "--wire")
    with open_port("canarm", "can0", host="127.0.0.1", port=emulator.port) as port:
        assert SdoSession(port, 0x612, 0x592, limit_s=60.0).upload(0x1000, 0)
    emulator.send(signal.SIGINT)
    assert emulator.wait() == 0
    assert re.fullmatch(
        r"canarm: wire: load \S+% since start, \S+% in the busiest second; worst response \S+ us \(0x\w{3}\); "
        "0 error frames, 0 frames lost",
        emulator.stderr[-1],
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--slcan", "socket://127.0.0.1"], "--slcan socket://127.0.0.1: write socket://HOST:PORT with"),
        (["--slcan", ""], "--slcan: the path is empty"),
        (["--slcan", "COM3"], "--slcan COM3: that is a serial port of Windows"),
        (["-i", "slcan"], "-i slcan: on which serial line? add its channel"),
    ],
)
def test_a_serial_line_that_cannot_be_is_refused_in_words(canarm, arguments, said):
    process = canarm("emulator", "--serve", "127.0.0.1:0", *arguments)
    assert process.wait() == 2
    assert said in process.complaint
    assert len(process.stderr) == 1


def test_one_client_too_many_is_told_so(canarm):
    emulator = canarm.emulator("sync")
    where = {"host": "127.0.0.1", "port": emulator.port}
    clients = [HubClientBus("can0", **where) for _ in range(64)]
    try:
        jog = canarm("jog", "--clock", "sync", "--connect", f"127.0.0.1:{emulator.port}", "--do", "read")
        assert jog.wait() == 1
        assert "it serves as many clients as it can; end one of them" in jog.complaint
        with socket.create_connection(("127.0.0.1", emulator.port), timeout=30.0) as one_more:
            assert one_more.recv(100) == b"< error too many clients >"
    finally:
        for client in clients:
            client.shutdown()


SIGNALLED = """
import os, sys
from canarm import entry

class Signalled:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            try:
                os.kill(os.getpid(), {number})
                for _ in range(1000):
                    pass
            except BaseException:
                raise ImportError("as extension modules do") from None

sys.meta_path.insert(0, Signalled())
sys.argv = ["canarm", {command!r}, "--seconds", "60"]
entry.main()
"""
LOST = """
import os, signal
from canarm import cli, entry

class Finalized:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000):
            pass

def run(*arguments, **options):
    Finalized()
    return 0

cli.app = run
entry.main()
"""


def python(script: str) -> tuple[int, str]:
    done = subprocess.run([sys.executable, "-c", script], stderr=subprocess.PIPE, text=True, timeout=60.0, check=False)
    return done.returncode, done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("command", "module"),
    [("demo", "canarm.cli"), ("emulator", "canarm.commands.emulator"), ("controller", "canarm_controller.run.loop")],
)
def test_a_signal_while_the_program_is_imported_is_a_line_and_status_1(command, module, number):
    script = SIGNALLED.format(module=module, number=int(number), command=command)
    assert python(script) == (1, "canarm: interrupted\n")


def test_a_signal_that_falls_into_a_finalizer_ends_the_program_all_the_same():
    assert python(LOST) == (1, "canarm: interrupted\n")


def test_the_example_says_what_is_missing_in_a_wrong_folder(tmp_path):
    script = Path(__file__).parents[2] / "examples" / "canopen_master.py"
    done = subprocess.run(
        [sys.executable, script, str(tmp_path)], capture_output=True, text=True, timeout=60.0, check=False
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert f"{tmp_path} has no konkuk1_dac.dcf; write it with: canarm export dcf" in done.stderr
