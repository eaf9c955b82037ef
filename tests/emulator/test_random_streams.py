"""Random bytes for everything that reads a stream from outside: parsers, hub, slcan adapters. One seed, random pieces.

Streams are pure noise, well-formed commands, and well-formed commands with damage. Nothing may escape as an exception,
nothing may be kept for ever, and who follows must be served.
"""

import contextlib
import os
import random
import socket
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

import pytest

from canarm_emulator.serving.hub import Hub
from canarm_emulator.serving.slcan import SlcanAdapter
from canarm_emulator.serving.slcan_port import SlcanPort, SlcanSocket
from canarm_emulator.serving.slcan_terminal import SlcanTerminal
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.transport.socketcand import ClientParser
from canarm_protocol.transport.socketcand_server import Bad, Command, Send, ServerParser

SEED = 20260
STREAMS = 50_000
"""For each of the two protocols."""
CONNECTIONS = 150
DEADLINE_S = 60.0

SOCKETCAND = (
    b"< open can0 >",
    b"< open bench >",
    b"< open vcan9 >",
    b"< rawmode >",
    b"< echo >",
    b"< send 123 2 1 f1 >",
    b"< send 1ABCDEF0 8 1 2 3 4 5 6 7 8 >",
    b"< send 80 0  >",
    b"< frame 123 1.5 AABB >",
    b"< frame 1ABCDEF0 12.000001  >",
    b"< error 004 1.0 >",
    b"< statistics 100 >",
    b"<>",
    b"< ",
    b" >",
    b"\r\n",
)
SLCAN = (
    b"C\r",
    b"O\r",
    b"L\r",
    b"S8\r",
    b"s031C\r",
    b"V\r",
    b"N\r",
    b"F\r",
    b"Z1\r",
    b"t10021133\r",
    b"T1ABCDEF081122334455667788\r",
    b"r1230\r",
    b"R1ABCDEF00\r",
    b"M00000000\r",
    b"\r",
    b"\r\n",
    b"\a",
)


def random_stream(source: random.Random, words: tuple[bytes, ...]) -> bytes:
    """Noise, words, or words with damage, of up to about 200 bytes."""
    kind = source.randrange(4)
    if kind == 0:
        return source.randbytes(source.randrange(120))
    stream = bytearray(b"".join(source.choices(words, k=source.randrange(1, 9))))
    if kind > 1:
        for _ in range(source.randrange(1, 5)):
            place = source.randrange(len(stream) + 1)
            if source.random() < 0.5:
                stream[place : place + source.randrange(4)] = b""
            else:
                stream[place:place] = source.randbytes(source.randrange(4))
    return bytes(stream)


def pieces(source: random.Random, stream: bytes) -> Iterator[bytes]:
    while stream:
        size = source.randrange(1, 60)
        yield stream[:size]
        stream = stream[size:]


@pytest.mark.slow
def test_the_socketcand_parsers_read_the_same_in_any_pieces_and_go_on_after_anything():
    source = random.Random(SEED)
    well_formed = 0
    server, client = ServerParser(), ClientParser()
    for _ in range(STREAMS):
        stream = random_stream(source, SOCKETCAND)
        commands = [command for piece in pieces(source, stream) for command in server.feed(piece)]
        # Where nonsense is cut does not matter; what makes sense is found wherever it is cut.
        sense = [command for command in commands if type(command) is not Bad]
        assert sense == [command for command in ServerParser().feed(stream) if type(command) is not Bad], stream
        well_formed += len(sense)
        for piece in pieces(source, stream):
            client.feed(piece)
        assert server.feed(b"\n>< send 7FF 1 ab >")[-1:] == [Send(Frame(0x7FF, b"\xab"))], stream
        assert client.feed(b"\n>< frame 7FF 1.5 AB >")[-1:] == [(1_500_000_000, Frame(0x7FF, b"\xab"))], stream
        assert {type(command) for command in sense} <= set(get_args(Command))
    assert well_formed > STREAMS  # so the streams are not all noise


@pytest.mark.slow
def test_the_slcan_adapter_reads_the_same_in_any_pieces_and_goes_on_after_anything():
    source = random.Random(SEED)
    taken = 0
    adapter, whole = SlcanAdapter(), SlcanAdapter()
    for _ in range(STREAMS):
        stream = random_stream(source, SLCAN)
        adapter.feed(b"O\r")
        whole.feed(b"O\r")
        frames, answers = [], b""
        for piece in pieces(source, stream):
            some_frames, some_answers = adapter.feed(piece)
            frames += some_frames
            answers += some_answers
        assert (frames, answers) == whole.feed(stream), stream
        # One answer a line, of six bytes at most (V's), and none before the line's end.
        assert stream.count(b"\r") <= len(answers) <= 6 * stream.count(b"\r")
        taken += len(frames)
        assert adapter.feed(b"\rC\rO\rt7FF1AB\r")[0][-1:] == [Frame(0x7FF, b"\xab")], stream
        whole.feed(b"\rC\rO\rt7FF1AB\r")
    assert taken > STREAMS // 4


@pytest.mark.parametrize("feed", [ServerParser().feed, ClientParser().feed, SlcanAdapter().feed])
@pytest.mark.parametrize("noise", ["random", "never-ending"])
def test_megabytes_of_noise_leave_nothing_behind(feed, noise):
    source = random.Random(SEED)
    tracemalloc.start()
    try:
        for _ in range(500):
            feed(source.randbytes(4096) if noise == "random" else b"< send t" * 512)
        kept_bytes, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept_bytes < 1_000_000  # of 2 MB; tables of what was read before, IDs for example, may stay


def until(happened: Callable[[], bool], run: Callable[[], object]) -> None:
    limit = time.monotonic() + DEADLINE_S
    while not happened():
        assert time.monotonic() < limit
        run()


def connect_badly(source: random.Random, address: tuple[str, int]) -> socket.socket:
    """A connection that ends with a reset, or with an end of file."""
    client = socket.create_connection(address)
    if source.random() < 0.5:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
    client.setblocking(False)
    return client


def test_a_hub_serves_its_good_client_whatever_others_say():
    source = random.Random(SEED)
    with contextlib.closing(Hub(port=0, queue_bytes=1 << 12)) as hub, contextlib.ExitStack() as stack:
        good = stack.enter_context(socket.create_connection(hub.address))
        good.setblocking(False)
        good.send(b"< open can0 >< rawmode >< echo >")
        heard = b""

        def hears(end: bytes) -> bool:
            nonlocal heard
            with contextlib.suppress(BlockingIOError):
                heard += good.recv(1 << 16)
            return heard.endswith(end)

        until(lambda: hears(b"< ok >< echo >"), lambda: hub.poll(0.01))
        visitors: list[socket.socket] = []
        for number in range(CONNECTIONS):
            visitor = connect_badly(source, hub.address)
            visitors.append(visitor)
            if source.random() < 0.5:
                visitor.send(b"< open can0 >< rawmode >")
            for piece in pieces(source, random_stream(source, SOCKETCAND)):
                with contextlib.suppress(ConnectionError, BlockingIOError):
                    visitor.send(piece)
                hub.poll(0)
            if source.random() < 0.7:
                visitors.pop(source.randrange(len(visitors))).close()
            hub.send("can0", number * 1000, Frame(0x191, b"\x01"))
            element = b"< frame 191 0.%06d 01 >" % number
            until(lambda: hears(element), lambda: (hub.flush(), hub.poll(0.01)))  # noqa: B023
        for visitor in visitors:
            visitor.close()
        until(lambda: len(hub.clients) == 1, lambda: hub.poll(0.01))
        assert heard.count(b"< frame 191 0.") == CONNECTIONS
        assert 1 not in hub.dropped


@pytest.mark.parametrize("kind", ["terminal", "socket"])
def test_an_slcan_adapter_serves_the_next_client_whatever_the_last_one_said(kind, tmp_path: Path):
    if kind == "terminal" and os.name != "posix":
        pytest.skip("this system has no pseudo-terminals")
    source = random.Random(SEED)
    port: SlcanPort = SlcanTerminal(tmp_path / "can0") if kind == "terminal" else SlcanSocket()

    @contextlib.contextmanager
    def visit() -> Iterator[tuple[Callable[[bytes], int], Callable[[int], bytes]]]:
        if isinstance(port, SlcanSocket):
            with connect_badly(source, port.address) as client:
                yield client.send, client.recv
        else:
            descriptor = os.open(tmp_path / "can0", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            yield lambda data: os.write(descriptor, data), lambda size: os.read(descriptor, size)
            os.close(descriptor)

    with port:
        for number in range(CONNECTIONS):
            with visit() as (say, _):
                for piece in pieces(source, random_stream(source, SLCAN)):
                    with contextlib.suppress(ConnectionError, BlockingIOError):
                        say(piece)
                    port.receive(0)
                    port.send([Frame(0x191, b"\x01")])
            with visit() as (say, hear):
                answers, frames = b"", []

                def is_served() -> bool:
                    nonlocal answers
                    with contextlib.suppress(BlockingIOError):
                        answers += hear(1 << 12)
                    return frames[-1:] == [Frame(number)] and answers.endswith(b"NCARM\r")  # noqa: B023

                say(b"\rC\rO\rt%03X0\rN\r" % number)
                until(is_served, lambda: frames.extend(frame for _, frame in port.receive(0.01)))  # noqa: B023
