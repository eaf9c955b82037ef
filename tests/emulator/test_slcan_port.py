"""slcan adapters on real pseudo-terminals and TCP ports: who comes, says too little, reads nothing, vanishes, returns.

Both kinds go through the same tests; what only a terminal or only a socket has follows at the end.
"""

import contextlib
import errno
import fcntl
import os
import pty
import select
import socket
import stat
import struct
import subprocess
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest

from canarm_emulator.serving.hub import Hub, HubError
from canarm_emulator.serving.hub_events import Ready
from canarm_emulator.serving.slcan_port import SlcanError, SlcanPort, SlcanSocket
from canarm_emulator.serving.slcan_terminal import SlcanTerminal, default_link
from canarm_protocol.canopen.frames import Frame

DEADLINE_S = 30.0


class TerminalClient:
    """A program that has the terminal open."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def say(self, data: bytes) -> int:
        return os.write(self._fd, data)

    def hear(self, size: int) -> bytes:
        return os.read(self._fd, size)

    def vanish(self) -> None:
        os.close(self._fd)


class SocketClient:
    """A program that is connected."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.socket = socket.create_connection(address)
        self.socket.setblocking(False)

    def say(self, data: bytes) -> int:
        return self.socket.send(data)

    def hear(self, size: int) -> bytes:
        return self.socket.recv(size)

    def vanish(self) -> None:
        # A reset, not an end of file.
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
        self.socket.close()


Client = TerminalClient | SocketClient


class Offered:
    """A port of one of the two kinds, and the way to it."""

    def __init__(self, kind: str, folder: Path, **options: int) -> None:
        self.port: SlcanPort
        if kind == "terminal":
            link = folder / "can0"
            self.port = SlcanTerminal(link, **options)
            self.channel = str(link)
            self.open: Callable[[], Client] = lambda: TerminalClient(link)
        else:
            self.port = SlcanSocket(**options)
            address = self.port.address
            self.channel = "socket://{}:{}".format(*address)
            self.open = lambda: SocketClient(address)

    def until(self, happened: Callable[[], bool]) -> list[Frame]:
        """Run the port until `happened`; return what it received meanwhile."""
        limit, frames = time.monotonic() + DEADLINE_S, []
        while not happened():
            assert time.monotonic() < limit, f"did not happen; received so far: {frames}"
            frames += [frame for _, frame in self.port.receive(0.01)]
        return frames

    def received(self, count: int) -> list[Frame]:
        frames: list[Frame] = []

        def is_complete() -> bool:
            frames.extend(frame for _, frame in self.port.receive(0.01))
            return len(frames) >= count

        self.until(is_complete)
        return frames

    def heard(self, client: Client, size: int) -> bytes:
        """`size` bytes that come to `client`, while the port is kept going."""
        data = b""

        def is_complete() -> bool:
            nonlocal data
            with contextlib.suppress(BlockingIOError):
                data += client.hear(size - len(data))
            return len(data) >= size

        self.until(is_complete)
        return data

    def settle(self) -> list[Frame]:
        """Run the port until it has nothing left to do; return what it received meanwhile."""
        fd, limit, frames = self.port.fileno(), time.monotonic() + DEADLINE_S, []
        assert fd is not None
        while select.select([fd], [], [], 0)[0]:
            assert time.monotonic() < limit, "the port never sleeps"
            frames += [frame for _, frame in self.port.receive(0)]
        return frames

    def until_left(self) -> None:
        """Run the port until it has noticed that its client, whose channel was open, is gone."""
        self.until(lambda: not self.port.is_open)

    def opened(self) -> Client:
        """A client with an open channel."""
        client = self.open()
        client.say(b"C\rO\r")
        assert self.heard(client, 2) == b"\r\r"
        return client


@pytest.fixture(params=["terminal", "socket"])
def kind(request) -> str:
    if request.param == "terminal" and os.name != "posix":
        pytest.skip("this system has no pseudo-terminals")
    return str(request.param)


@pytest.fixture
def offered(kind, tmp_path) -> Iterator[Offered]:
    offered = Offered(kind, tmp_path)
    yield offered
    offered.port.close()


@contextlib.contextmanager
def answering(port: SlcanPort) -> Iterator[None]:
    """The port in a thread that answers frame n with n + 1."""
    is_over = threading.Event()

    def run() -> None:
        while not is_over.is_set():
            for time_ns, frame in port.receive(0.01):
                port.send_stamped([(time_ns, frame._replace(can_id=frame.can_id + 1))])

    thread = threading.Thread(target=run)
    thread.start()
    yield
    is_over.set()
    thread.join()


def test_frames_go_both_ways(offered):
    client = offered.opened()
    client.say(b"t0802AB12\rT1ABCDEF00\r")
    assert offered.received(2) == [Frame(0x080, b"\xab\x12"), Frame(0x1ABCDEF0, is_extended=True)]
    assert offered.heard(client, 4) == b"z\rZ\r"
    offered.port.send_stamped([(0, Frame(0x191, b"\x01")), (0, Frame(0x192))])
    assert offered.heard(client, 14) == b"t191101\rt1920\r"


def test_time_stamps_are_those_of_the_bus(offered):
    client = offered.opened()
    client.say(b"Z1\r")
    assert offered.heard(client, 1) == b"\r"
    offered.port.send_stamped([(60_042_000_000, Frame(0x191))])
    assert offered.heard(client, 10) == b"t1910002A\r"


def test_python_cans_stock_driver_works_as_it_is(offered):
    with (
        answering(offered.port),
        can.Bus(interface="slcan", channel=offered.channel, bitrate=1_000_000, sleep_after_open=0) as bus,
    ):
        assert bus.get_version(DEADLINE_S) == (10, 13)
        for number in range(30):
            for can_id in (0x10, 0x20):
                bus.send(can.Message(arbitration_id=can_id, data=[number, 0x0D], is_extended_id=False))
            answers = [bus.recv(DEADLINE_S) for _ in range(2)]
            assert [answer.arbitration_id for answer in answers] == [0x11, 0x21]
            assert [bytes(answer.data) for answer in answers] == [bytes((number, 0x0D))] * 2


def test_clients_come_one_after_the_other_and_find_the_adapter_as_new(offered):
    for number in range(20):
        client = offered.open()
        client.say(b"V\r")  # no C first
        assert offered.heard(client, 6) == b"V1013\r"
        client.say(b"t0010\r")
        assert offered.heard(client, 1) == b"\a"
        client.say(b"O\rt%03X0\r" % number)
        assert offered.received(1) == [Frame(number)]
        assert offered.heard(client, 3) == b"\rz\r"
        client.vanish()
        offered.until_left()
    assert offered.port.dropped == 0


@pytest.mark.parametrize("said", [b"", b"t08", b"O\rt0800\rt08", b"\x00\xff\a\n\r\r", b"t" * 1000])
def test_a_client_may_vanish_at_any_word(offered, said):
    client = offered.open()
    if said:
        client.say(said)
    client.vanish()
    # The next one may come before that is noticed. As LAWICEL says, it ends what somebody may have begun.
    following = offered.open()
    following.say(b"\r\rC\rO\rN\r")
    answers = b""
    while not answers.endswith(b"NCARM\r"):
        answers += offered.heard(following, 1)
    following.say(b"t0012ABCD\r")
    assert offered.received(1)[-1] == Frame(1, b"\xab\xcd")


def test_a_client_that_never_reads_loses_the_newest_whole_frames(kind, tmp_path):
    offered = Offered(kind, tmp_path, queue_bytes=1 << 12)
    client = offered.opened()
    number = 0
    while not offered.port.dropped:  # until the kernel's buffers, some MB for a socket, and the queue are full
        assert number < 1_000_000
        batch = [(0, Frame(0x191, following.to_bytes(8, "big"))) for following in range(number, number + 1000)]
        offered.port.send_stamped(batch)
        number += len(batch)
    kept = number - offered.port.dropped
    expected = b"".join(b"t1918%016X\r" % following for following in range(kept))
    assert offered.heard(client, len(expected)) == expected
    offered.port.send_stamped([(0, Frame(0x192))])
    assert offered.heard(client, 6) == b"t1920\r"
    offered.port.close()


def test_what_a_client_left_unread_does_not_meet_the_next_one(kind, tmp_path):
    offered = Offered(kind, tmp_path, queue_bytes=1 << 12)
    client = offered.opened()
    while not offered.port.dropped:
        offered.port.send_stamped([(0, Frame(0x191, bytes(8)))] * 1000)
    client.vanish()
    offered.until_left()
    following = offered.open()
    following.say(b"N\r")
    assert offered.heard(following, 6) == b"NCARM\r"
    offered.port.close()


def test_a_client_that_asks_much_and_reads_nothing_fills_no_memory(kind, tmp_path):
    offered = Offered(kind, tmp_path, queue_bytes=1 << 12)
    client = offered.opened()
    asked = 0
    while asked < 1_000_000:
        with contextlib.suppress(BlockingIOError):
            asked += client.say(b"V\r" * 1000)
        offered.port.receive(0)
        assert len(offered.port._output) <= 1 << 12
    offered.port.close()


def test_nobody_there_is_no_error(offered):
    offered.port.send([Frame(1)])
    assert offered.port.receive(0) == []
    assert offered.port.dropped == 0


def test_a_hub_waits_for_the_port_and_sleeps_when_nobody_speaks(offered):
    hub = Hub(port=0)
    hub.watch(offered.port)
    assert hub.poll(0) == []
    client = offered.open()
    client.say(b"O\rt0800\r")
    frames: list[Frame] = []
    while not frames:
        assert hub.poll(DEADLINE_S) == [Ready(offered.port)]
        frames += [frame for _, frame in offered.port.receive(0)]
    assert hub.poll(0) == []
    client.vanish()
    assert hub.poll(DEADLINE_S) == [Ready(offered.port)]
    offered.port.receive(0)
    assert hub.poll(0) == []  # an end is one event, not one for ever
    hub.close()


def test_closing_twice_is_no_error(offered):
    offered.opened()
    offered.port.close()
    offered.port.close()
    offered.port.send([Frame(1)])


def test_a_terminal_is_named_by_a_link_that_goes_with_it(tmp_path):
    link = tmp_path / "can0"
    port = SlcanTerminal(link)
    assert port.description == f"-i slcan -c {link}"
    assert stat.S_ISCHR(link.stat().st_mode)
    port.close()
    assert not link.is_symlink()


def test_a_relative_name_and_one_with_blanks_are_announced_so_that_a_shell_finds_them(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with SlcanTerminal(Path("my can0")) as port:
        assert port.description == f"-i slcan -c '{tmp_path}/my can0'"


def test_without_a_name_the_link_is_the_users_own(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert default_link() == tmp_path / "canarm-can0"
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "missing"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert default_link() == tmp_path / f"canarm-{os.getuid()}-can0"


def test_the_link_of_a_killed_emulator_is_replaced(tmp_path):
    link = tmp_path / "can0"
    link.symlink_to(tmp_path / "gone")
    with SlcanTerminal(link):
        assert link.exists()


@pytest.mark.parametrize("what", ["file", "another's link"])
def test_a_name_that_is_taken_is_left_alone(tmp_path, what):
    path = tmp_path / "can0"
    if what == "file":
        path.write_text("precious")
        with pytest.raises(SlcanError, match="that name is taken; if no other emulator uses it, remove it, or"):
            SlcanTerminal(path)
        assert path.read_text() == "precious"
    else:
        with SlcanTerminal(path) as first:
            with pytest.raises(SlcanError, match="that name is taken"):
                SlcanTerminal(path)
            assert path.exists()
            assert first.receive(0) == []


def test_a_name_in_no_folder_is_refused(tmp_path):
    with pytest.raises(SlcanError, match=r"--slcan .*/missing/can0: No such file or directory; choose another PATH"):
        SlcanTerminal(tmp_path / "missing" / "can0")


def test_a_terminal_is_raw_also_after_a_client_has_changed_that(tmp_path):
    offered = Offered("terminal", tmp_path)
    client = offered.opened()
    fd = client._fd
    settings = tty.tcgetattr(fd)
    assert not settings[tty.LFLAG] & (tty.ICANON | tty.ECHO)
    settings[tty.LFLAG] |= tty.ICANON | tty.ECHO
    tty.tcsetattr(fd, tty.TCSANOW, settings)
    client.vanish()
    offered.until_left()
    following = offered.open()
    assert not tty.tcgetattr(following._fd)[tty.LFLAG] & (tty.ICANON | tty.ECHO)
    offered.port.close()


def test_a_second_connection_is_sent_away_while_the_first_has_its_channel_open(tmp_path):
    offered = Offered("socket", tmp_path)
    first = offered.opened()
    second = offered.open()
    second.socket.settimeout(DEADLINE_S)
    offered.port.receive(DEADLINE_S)
    assert second.hear(1) == b""
    first.say(b"V\r")
    assert offered.heard(first, 6) == b"V1013\r"
    offered.port.close()


def test_a_connection_that_says_nothing_makes_room(tmp_path):
    offered = Offered("socket", tmp_path)
    silent = offered.open()
    silent.socket.settimeout(DEADLINE_S)
    offered.port.receive(DEADLINE_S)
    second = offered.opened()
    assert silent.hear(1) == b""
    second.say(b"V\r")
    assert offered.heard(second, 6) == b"V1013\r"
    offered.port.close()


def test_a_port_for_others_needs_to_be_meant():
    with pytest.raises(HubError, match=r"can be reached from the network.*--allow-remote"):
        SlcanSocket("0.0.0.0")
    with SlcanSocket("0.0.0.0", allow_remote=True) as port:
        assert port.description == f"-i slcan -c socket://0.0.0.0:{port.address[1]}"


def test_a_port_in_use_names_the_option():
    with SlcanSocket() as port:
        host, number = port.address
        with pytest.raises(HubError) as caught:
            SlcanSocket(host, number)
        assert isinstance(caught.value.__cause__, OSError)
        assert caught.value.__cause__.errno == errno.EADDRINUSE
        assert str(caught.value).endswith("choose another --slcan socket://HOST:PORT")


def lock(fd: int) -> None:
    fcntl.ioctl(fd, termios.TIOCEXCL)


def forbid(fd: int) -> None:
    os.fchmod(fd, 0)


def discipline(number: int) -> Callable[[int], None]:
    return lambda fd: fcntl.ioctl(fd, termios.TIOCSETD, struct.pack("i", number)) and None


def stop(fd: int) -> None:
    termios.tcflow(fd, termios.TCOOFF)


def send_xoff(fd: int) -> None:
    termios.tcflow(fd, termios.TCIOFF)


def cook(fd: int) -> None:
    settings = termios.tcgetattr(fd)
    settings[tty.IFLAG] |= termios.IXON | termios.IXOFF | termios.ICRNL | termios.ISTRIP
    settings[tty.OFLAG] |= termios.OPOST | termios.OLCUC
    settings[tty.LFLAG] |= termios.ICANON | termios.ECHO | termios.TOSTOP
    settings[tty.ISPEED] = settings[tty.OSPEED] = termios.B0
    settings[tty.CC][termios.VSTART] = settings[tty.CC][termios.VSTOP] = b"O"
    termios.tcsetattr(fd, termios.TCSANOW, settings)


MISCHIEF = {
    "exclusive": lock,
    "mode 0": forbid,
    "TCOOFF": stop,
    "TCIOFF": send_xoff,
    "termios": cook,
    "N_NULL": discipline(27),
    "slcand": discipline(17),
    "PPP": discipline(3),
    "SLIP": discipline(1),
}


@pytest.fixture(params=MISCHIEF)
def mischief(request) -> Callable[[int], None]:
    def do(fd: int) -> None:
        try:
            MISCHIEF[request.param](fd)
        except OSError as error:
            pytest.skip(f"this kernel: {error}")

    return do


def test_whatever_a_serial_client_does_to_its_end_the_next_one_finds_an_adapter(tmp_path, mischief):
    # linux/tty.h numbers the line disciplines; slcand sets 17 and leaves it behind when a signal ends it.
    offered = Offered("terminal", tmp_path)
    client = offered.opened()
    mischief(client._fd)
    client.vanish()
    offered.until_left()
    following = offered.opened()
    following.say(b"t08011A\r")
    assert offered.received(1) == [Frame(0x080, b"\x1a")]
    offered.port.close()
    assert not os.path.lexists(tmp_path / "can0")


@pytest.mark.skipif(not hasattr(select, "epoll"), reason="without edges a client that says nothing is not seen to go")
def test_whatever_a_client_does_that_never_says_a_word_the_next_one_finds_the_terminal_as_new(tmp_path, mischief):
    offered = Offered("terminal", tmp_path)
    link = tmp_path / "can0"
    as_new = offered.open()
    settings, mode = termios.tcgetattr(as_new._fd), link.stat().st_mode
    as_new.vanish()
    offered.settle()
    client = offered.open()
    mischief(client._fd)
    client.vanish()
    offered.settle()
    assert link.stat().st_mode == mode
    following = offered.opened()
    assert termios.tcgetattr(following._fd) == settings
    is_exclusive = fcntl.ioctl(following._fd, 0x80045440, bytes(4))  # TIOCGEXCL, asm-generic/ioctls.h
    assert struct.unpack("i", is_exclusive) == (0,)
    following.say(b"t08011A\r")
    assert offered.received(1) == [Frame(0x080, b"\x1a")]
    assert offered.settle() == []  # and the emulator sleeps again
    offered.port.close()


@pytest.mark.parametrize("mischief", [stop, send_xoff])
def test_a_client_that_stops_the_line_and_stays_stops_nobody(tmp_path, mischief):
    offered = Offered("terminal", tmp_path)
    silent = offered.open()
    mischief(silent._fd)
    offered.settle()
    following = offered.opened()
    following.say(b"t08011A\r")
    assert offered.received(1) == [Frame(0x080, b"\x1a")]
    mischief(silent._fd)
    offered.settle()
    following.say(b"t08011B\r")
    assert offered.received(1) == [Frame(0x080, b"\x1b")]
    offered.port.close()


def test_an_echo_that_a_client_switches_on_does_not_keep_the_adapter_answering_itself(tmp_path):
    offered = Offered("terminal", tmp_path)
    client = offered.open()
    settings = termios.tcgetattr(client._fd)
    settings[tty.LFLAG] |= termios.ECHO
    termios.tcsetattr(client._fd, termios.TCSANOW, settings)
    client.say(b"O\r")
    assert offered.heard(client, 1) == b"\r"
    offered.port.send([Frame(0x191)] * 1000)
    assert offered.heard(client, 6000) == b"t1910\r" * 1000
    client.say(b"t08011A\r")
    assert offered.received(1) == [Frame(0x080, b"\x1a")]
    assert offered.port.refused == 0
    offered.port.close()


def test_a_terminal_that_its_clients_session_hangs_up_is_put_right_for_the_next(tmp_path):
    offered = Offered("terminal", tmp_path)
    claim = "import fcntl, os, sys, termios; fcntl.ioctl(os.open(sys.argv[1], os.O_RDWR), termios.TIOCSCTTY, 1)"
    subprocess.run([sys.executable, "-c", claim, offered.channel], start_new_session=True, check=True)
    offered.settle()
    following = offered.opened()
    following.say(b"t08011A\r")
    assert offered.received(1) == [Frame(0x080, b"\x1a")]
    offered.port.close()


def test_a_terminal_that_cannot_be_put_right_is_replaced_under_its_name(tmp_path, monkeypatch):
    offered = Offered("terminal", tmp_path)

    def refuse(*arguments: object) -> None:
        monkeypatch.undo()  # the new terminal is as good as any
        raise termios.error(5, "Input/output error")

    client = offered.opened()
    monkeypatch.setattr(termios, "tcsetattr", refuse)
    client.vanish()
    offered.until_left()
    assert offered.port.replaced == 1
    following = offered.opened()
    following.say(b"t08011A\r")
    assert offered.received(1) == [Frame(0x080, b"\x1a")]
    assert (tmp_path / "can0").exists()
    offered.port.close()


def test_without_another_terminal_the_rest_of_the_bench_goes_on(tmp_path, monkeypatch, caplog):
    offered = Offered("terminal", tmp_path)
    client = offered.opened()

    def refuse(*arguments: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(termios, "tcsetattr", refuse)
    monkeypatch.setattr(pty, "openpty", refuse)
    client.vanish()
    offered.until_left()
    assert offered.port.receive(0) == []
    assert "there is no other: [Errno 24] Too many open files" in caplog.text
    offered.port.close()
