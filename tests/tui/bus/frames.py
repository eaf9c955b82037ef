"""Frames for tests of the bus: as cansend takes them, and cycles as a bench in lockstep sends them."""

from canarm_protocol.canopen.frames import Frame


def frame(text: str) -> Frame:
    """A frame as cansend takes it."""
    can_id, _, data = text.partition("#")
    return Frame(int(can_id, 16), bytes.fromhex(data), len(can_id) == 8)


def at_once(job):
    """Jobs of the background, done in the foreground."""
    job()


def cycles(first: int, count: int):
    """Cycles of konkuk1's bus in lockstep, 2.5 ms each, with codes that change; heartbeats every 20 ms."""
    found = []
    for cycle in range(first, first + count):
        time_ns = cycle * 2_500_000
        code = (cycle % 256 << 7).to_bytes(2, "little")
        found += [
            (time_ns, Frame(0x080, bytes([cycle % 240 + 1]))),
            (time_ns + 600_000, Frame(0x294, code + bytes.fromhex("0040803F803F"))),
            (time_ns + 600_000, Frame(0x394, code + bytes(2))),
            (time_ns + 600_000, Frame(0x312, bytes.fromhex("00220000"))),
            (time_ns + 600_000, Frame(0x213, b"\x02")),
        ]
        if cycle % 8 == 0:
            found += [(time_ns, Frame(0x700 + node_id, b"\x05")) for node_id in (0x01, 0x12, 0x13, 0x14)]
    return found


async def filled(app, port, clock, pilot, seconds=2.0):
    """Some seconds of a run, in drains of 20 ms."""
    for first in range(0, round(seconds * 400), 8):
        clock.advance(0.02)
        port.arriving = cycles(first, 8)
        app.drain()
    app.redraw()
    await pilot.pause()


async def shown(app, pilot):
    """What the timers do sooner or later, now."""
    app.drain()
    app.redraw()
    await pilot.pause()
