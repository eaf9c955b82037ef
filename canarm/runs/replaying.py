"""Recorded frames sent again, on any bus: at the times of the record, or as fast as the bus takes them.

Owns the order and the pace. Which frames, and over which bus, is the caller's choice.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from canarm_protocol.canopen.frames import Cob, Frame
from canarm_protocol.errors import BusError
from canarm_protocol.transport.port import BusPort

from .decoding import Decoder

ANSWER_S = 30.0
"""How long a lockstep emulator may take for a cycle: longer than any slow machine."""
BATCH = 256
"""Frames that are sent together where no time is kept."""
SLICE_S = 0.05
"""Longest wait before the bus is read again: what nobody reads would pile up."""


@dataclass
class Replayed:
    """What has been sent so far."""

    frames: int = 0
    late_s: float = 0.0
    """By how much the last of them came after its time."""


def replay_timed(
    frames: Iterable[tuple[int, Frame]],
    port: BusPort,
    speed: float,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Replayed:
    """Send `frames` at their times, `speed` times as fast; an infinite speed waits for nothing. Raises `BusError`."""
    done, begin_s, first_ns = Replayed(), clock(), None
    batch: list[Frame] = []
    for time_ns, frame in frames:
        first_ns = time_ns if first_ns is None else first_ns
        due_s = begin_s + (time_ns - first_ns) * 1e-9 / speed
        if batch and (len(batch) >= BATCH or due_s > clock()):
            _send(port, batch, done)
        while (left_s := due_s - clock()) > 0.0:
            sleep(min(left_s, SLICE_S))
            port.receive(0.0)
        done.late_s = max(clock() - due_s, 0.0)
        batch.append(frame)
    _send(port, batch, done)
    return done


class Answers:
    """Compares what the cards say now with what they have said in a record, in order, up to the first difference.

    `recorded` are the frames of a log, with numbers from 1; what came before the master's first frame is left out, for
    nobody is attached then. Error frames are not compared.
    """

    def __init__(self, recorded: Iterable[tuple[int, Frame]], decoder: Decoder) -> None:
        self._expected = self._of_cards(recorded, decoder)
        self.same = 0
        """How many frames have been the same."""
        self.difference: tuple[int, Frame, Frame] | None = None
        """Number in the log, recorded, and now, of the first frame that differs."""

    @staticmethod
    def _of_cards(recorded: Iterable[tuple[int, Frame]], decoder: Decoder) -> Iterator[tuple[int, Frame]]:
        has_begun = False
        for number, (_, frame) in enumerate(recorded, start=1):
            is_of_cards = frame.is_error or decoder.is_from_cards(frame)
            has_begun = has_begun or not is_of_cards
            if is_of_cards and has_begun and not frame.is_error:
                yield number, frame

    def take(self, frames: Iterable[tuple[int, Frame]]) -> None:
        """What the bus has brought."""
        for _, now in frames:
            if self.difference is not None or now.is_error:
                continue
            number, then = next(self._expected, (0, now))
            if now == then:
                self.same += number > 0
            else:
                self.difference = number, then, now


def replay_lockstep(frames: Iterable[tuple[int, Frame]], port: BusPort, answers: Answers | None = None) -> Replayed:
    """Send `frames` to an emulator in lockstep: after each SYNC its TIME is awaited. Raises `BusError`.

    `answers` is given what the emulator says.
    """
    done, batch = Replayed(), []
    for _, frame in frames:
        batch.append(frame)
        if frame.can_id == Cob.SYNC and not frame.is_extended and not _send(port, batch, done, answers):
            _await_time(port, done, answers)
    _send(port, batch, done, answers)
    return done


def of_master(frames: Iterable[tuple[int, Frame]], decoder: Decoder) -> Iterator[tuple[int, Frame]]:
    """Of `frames` those that the cards have not sent."""
    return (each for each in frames if not decoder.is_from_cards(each[1]))


def without_errors(frames: Iterable[tuple[int, Frame]]) -> Iterator[tuple[int, Frame]]:
    """Of `frames` those that can be sent: no error frames."""
    return (each for each in frames if not each[1].is_error)


def _send(port: BusPort, batch: list[Frame], done: Replayed, answers: Answers | None = None) -> bool:
    """Send, and read what has come; returns whether there was a TIME."""
    port.send(batch)
    done.frames += len(batch)
    batch.clear()
    return _has_time(port, 0.0, answers)


def _await_time(port: BusPort, done: Replayed, answers: Answers | None) -> None:
    limit_s = time.monotonic() + ANSWER_S
    while (left_s := limit_s - time.monotonic()) > 0.0:
        if _has_time(port, left_s, answers):
            return
    raise BusError(f"no TIME within {ANSWER_S:g} s of frame {done.frames}, a SYNC: is an emulator in lockstep there?")


def _has_time(port: BusPort, wait_s: float, answers: Answers | None) -> bool:
    received = port.receive(wait_s)
    if answers is not None:
        answers.take(received)
    return any(frame.can_id == Cob.TIME for _, frame in received)
