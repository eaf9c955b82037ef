"""A real emulator process in lockstep for the examples, and SocketCAN's face where the kernel has none."""

import os
import select
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from canarm.child import Child
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.transport.port import open_port

ROOT = Path(__file__).parents[2]
DEADLINE_S = 120.0
CAN_FRAME = struct.Struct("=IB3x8s")
"""struct can_frame of linux/can.h."""
SHIM = """
#define _GNU_SOURCE
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>
int socket(int domain, int type, int protocol)
{
    return domain == AF_CAN ? atoi(getenv("CAN_FD")) : (int)syscall(SYS_socket, domain, type, protocol);
}
int bind(int fd, const struct sockaddr *address, socklen_t size) { return (void)fd, (void)address, (void)size, 0; }
int ioctl(int fd, unsigned long request, ...) { return (void)fd, (void)request, 0; }
"""


@pytest.fixture
def emulator() -> Iterator[int]:
    """The port of an emulator of its own, in lockstep, which gives a busy machine time."""
    arguments = ["--serve", "127.0.0.1:0", "--clock", "sync", "--sync-timeout", "60"]
    with Child("emulator", arguments, quiet=True) as child:
        match = child.wait_for(r"^bench .*port=(\d+)\b", DEADLINE_S)
        assert match is not None, child.complaints
        yield int(match.group(1))


@pytest.fixture
def run_python(starter):
    """Run a program in Python to its end."""

    def run(*words: object) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, *map(str, words)]
        if starter is None:
            return subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S)
        fork = starter.start(command[1:], Path.cwd(), os.environ)
        said = fork.communicate(DEADLINE_S)
        return subprocess.CompletedProcess(command, fork.wait(DEADLINE_S), *said)

    return run


@pytest.fixture
def compile_c(tmp_path):
    """Compile C source; the output file."""

    def compile_(name: str, source: Path | str, *flags: str) -> Path:
        if isinstance(source, str):
            (tmp_path / f"{name}.c").write_text(source)
            source = tmp_path / f"{name}.c"
        subprocess.run(["cc", *flags, "-o", tmp_path / name, source], check=True, timeout=DEADLINE_S)
        return tmp_path / name

    return compile_


@pytest.fixture
def run_on_can(compile_c):
    """Run a program that opens a raw CAN socket: the socket is a pair of ours, bridged to an emulator's can0."""

    def run(port: int, *command: object) -> tuple[int, str]:
        shim = compile_c("shim.so", SHIM, "-shared", "-fPIC")
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        environment = {**os.environ, "LD_PRELOAD": str(shim), "CAN_FD": str(theirs.fileno())}
        with ours, open_port("canarm", "can0", host="127.0.0.1", port=port) as bus:
            process = subprocess.Popen(
                list(map(str, command)),
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                env=environment,
                pass_fds=[theirs.fileno()],
            )
            theirs.close()
            try:
                while _bridge(ours, bus):
                    pass
                text, _ = process.communicate(timeout=DEADLINE_S)
            finally:
                process.kill()
        return process.returncode, text

    return run


def _bridge(ours: socket.socket, bus) -> bool:
    """Pass on what has arrived on either side; False once the program has closed its socket."""
    ready, _, _ = select.select([ours, bus], [], [], DEADLINE_S)
    assert ready, "neither the program nor the emulator says anything"
    if bus in ready:
        for _, frame in bus.receive(0.0):
            ours.send(CAN_FRAME.pack(frame.can_id, len(frame.data), frame.data))
    if ours in ready:
        record = ours.recv(CAN_FRAME.size)
        if not record:
            return False
        can_id, size, data = CAN_FRAME.unpack(record)
        bus.send([Frame(can_id, data[:size])])
    return True


@pytest.fixture
def root() -> Path:
    return ROOT
