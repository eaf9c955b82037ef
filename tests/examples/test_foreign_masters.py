"""The masters of `examples/` drive a real emulator process, and leave its cards safe."""

import math
import re
import shutil
import struct
import subprocess
import sys

import pytest

from canarm_protocol.cell.bench_objects import TRUE_ANGLE, sdo_channel
from canarm_protocol.transport.port import open_port
from canarm_protocol.transport.sdo_session import SdoSession

NEEDS_A_COMPILER = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="needs Linux and a C compiler named cc"
)
GOAL_DEG, TOLERANCE_DEG = 40.0, 5.0


def truth(port: int, index: int, joint: int) -> float:
    """What the bench node knows of a joint."""
    with open_port("canarm", "bench", host="127.0.0.1", port=port) as bench:
        return float(
            struct.unpack("<f", SdoSession(bench, *sdo_channel(0x70, 3), limit_s=20.0).upload(index, joint))[0]
        )


def check(port: int, status: int, text: str) -> None:
    """It says that it has arrived, it has, and the amplifier is off."""
    assert status == 0, text
    shown = re.search(r"joint 2 is at (\S+) deg", text)
    assert shown, text
    assert float(shown[1]) == pytest.approx(GOAL_DEG, abs=TOLERANCE_DEG)
    with open_port("canarm", "can0", host="127.0.0.1", port=port) as robot:
        assert not any(SdoSession(robot, 0x612, 0x592, limit_s=20.0).upload(0x6411, 1))
        assert not any(SdoSession(robot, 0x613, 0x593, limit_s=20.0).upload(0x6200, 1))
    # One LSB of the potentiometer is 1.06 degrees, and the noise is 0.3 LSB.
    assert math.degrees(truth(port, TRUE_ANGLE, 1)) == pytest.approx(float(shown[1]), abs=2.5)


def test_python_canopen_drives_the_cards_from_the_exported_dcfs(emulator, run_python, root, tmp_path):
    exported = run_python("-m", "canarm", "export", "dcf", "--out", tmp_path / "dcf")
    assert exported.returncode == 0, exported.stderr
    for interface in ("canarm", "socketcand"):
        done = run_python(
            root / "examples" / "canopen_master.py", tmp_path / "dcf", "--port", emulator, "--interface", interface
        )
        check(emulator, done.returncode, done.stdout + done.stderr)
        assert done.stderr == ""


@NEEDS_A_COMPILER
def test_the_master_in_c_compiles_without_warnings_and_drives_the_cards(emulator, compile_c, run_on_can, root):
    source = root / "examples" / "c_master" / "master.c"
    master = compile_c("master", source, "-std=c11", "-O2", "-Wall", "-Wextra", "-Werror")
    status, text = run_on_can(emulator, master, "vcan0", 2)
    check(emulator, status, text)


@NEEDS_A_COMPILER
@pytest.mark.parametrize("arguments", [[], ["vcan0", "soon"], ["vcan0", "-1"], ["vcan0", "2", "3"]])
def test_the_master_in_c_refuses_wrong_arguments(compile_c, root, arguments):
    master = compile_c("master", root / "examples" / "c_master" / "master.c")
    done = subprocess.run([master, *arguments], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert "such as: master vcan0 2" in done.stderr
