"""A bus as lines of text, as candump shows it, with what each frame means. Without a terminal, and for pipes."""

import time
from collections.abc import Callable
from typing import TextIO

from canarm_protocol.decoding import Decoder, raw_text
from canarm_protocol.shown import printable
from canarm_protocol.transport.port import BusPort

from .filtering import FrameFilter

READ_S = 0.1
"""Longest wait for a frame, after which it is asked whether to go on."""
LONGEST = 400


def write_lines(
    port: BusPort, decoder: Decoder, wanted: FrameFilter, out: TextIO, until: Callable[[], bool] = lambda: False
) -> int:
    """Write a line for each frame that is `wanted` until `until` is true; returns how many frames were received.

    Each line has the time on the bus's clock, the frame in candump's log format, and its meaning. Raises `BusError`
    when the bus is lost, `BrokenPipeError` when nobody reads.
    """
    received = 0
    while not until():
        frames = port.receive(READ_S)
        lines = []
        for time_ns, frame in frames:
            meaning = decoder.meaning(frame, decoder.follow(frame))
            if wanted.fits(frame, meaning):
                mark = "▲ " if meaning.is_wrong else ""
                lines.append(f"({time_ns * 1e-9:.6f}) {raw_text(frame):<20} {mark}{printable(str(meaning), LONGEST)}\n")
        received += len(frames)
        if lines:
            out.write("".join(lines))
            out.flush()
    return received


def after(seconds: float | None, clock_s: Callable[[], float] = time.monotonic) -> Callable[[], bool]:
    """Whether `seconds` have passed since now; without a number, never."""
    if seconds is None:
        return lambda: False
    end_s = clock_s() + seconds
    return lambda: clock_s() >= end_s
