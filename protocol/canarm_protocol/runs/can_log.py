"""Reading the candump log of a run, also of one that was cut off or damaged: lines that can be read are read.

python-can's reader ends at the first line that is none.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

from ..canopen.frames import Frame
from .parts import parts_of
from .run_folder import LOG_START_S

_LINE = re.compile(
    rb"\((\d{1,10})\.(\d{6})\) \S{1,20} (?:([0-9A-F]{3})|([0-9A-F]{8}))#(?:(R)([0-8]?)|((?:[0-9A-F]{2}){0,8}))\s*"
)
LONGEST_LINE = 200
"""Bytes; a frame of classic CAN takes 60."""


def log_frames(path: Path, complain: Callable[[str], None] = lambda text: None) -> Iterator[tuple[int, Frame]]:
    """The frames of a log, and before them those of its parts, with their virtual times since power-on, in ns.

    `complain` is told, at the end, of lines that are no frames. A file that is no log at all has none.
    """
    for part in parts_of(path):
        yield from _frames(part, complain)


def _frames(path: Path, complain: Callable[[str], None]) -> Iterator[tuple[int, Frame]]:
    bad = 0
    try:
        if not path.is_file():
            return
        with path.open("rb") as file:
            while line := file.readline(LONGEST_LINE):
                found = _LINE.fullmatch(line)
                if found is None:
                    bad += line != b"\n"
                else:
                    yield _stamped(found)
    except OSError as error:
        complain(f"{path.name}: cannot be read: {error.strerror}")
    if bad:
        complain(f"{path.name}: {bad} {'line is' if bad == 1 else 'lines are'} no frame and left out")


def _stamped(found: re.Match[bytes]) -> tuple[int, Frame]:
    seconds, micros, short, long, remote, length, data = found.groups()
    time_ns = ((int(seconds) - LOG_START_S) * 1_000_000 + int(micros)) * 1000
    payload = bytes(int(length or 0)) if remote else bytes.fromhex(data.decode("ascii"))
    return time_ns, Frame(int(short or long, 16), payload, long is not None, remote is not None)
