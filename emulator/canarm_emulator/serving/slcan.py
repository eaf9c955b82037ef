"""The adapter's side of slcan, the ASCII protocol of serial CAN adapters: bytes in, values out.

Source: LAWICEL CAN232 manual, version 3, and python-can's `slcan` driver. A line ends with CR; the answer is CR, or BEL
if it is refused. No terminals, sockets, clocks or waiting enter here. No input raises an error.
"""

from canarm_protocol.canopen.frames import Frame

MAX_LINE = 64
"""Longest line in bytes. The longest valid line, an extended frame with a time stamp, has 30."""

OK, REFUSED = b"\r", b"\a"
VERSION = b"V1013\r"
"""Hardware 1.0, software 1.3."""
SERIAL_NUMBER = b"NCARM\r"
STATUS_FLAGS = b"F00\r"
"""No error: bus-off and full queues are never reported here; frames lost by a slow reader are counted elsewhere."""
STAMP_RANGE_MS = 60_000
"""Time stamps count from 0 to 0xEA5F ms and start again."""

FLOW_CONTROL = b"\x11\x13"
"""XON and XOFF, which a client's driver may send (`tcflow`, IXOFF); no line has them, and they are ignored."""

_HEX_DIGITS = frozenset(b"0123456789abcdefABCDEF")
_DATA_LENGTHS = {b"%d" % length: length for length in range(9)}
_SETTINGS = {
    # Command: how many hex digits follow. Accepted without effect; filters too: the client gets everything.
    ord("M"): 8,
    ord("m"): 8,
    ord("W"): 1,
    ord("U"): 1,
}


class SlcanAdapter:
    """One emulated adapter. It starts closed, and neither accepts nor passes on frames until it is opened.

    Any bit rate is accepted: the emulated bus has that of its cell. `refused` counts the lines answered with BEL.
    """

    def __init__(self) -> None:
        self.refused = 0
        self.reset()

    def reset(self) -> None:
        """Be as after power-on: closed, without time stamps, and without the beginning of a line."""
        self.is_open = False
        self.is_listening_only = False
        self.has_stamps = False
        self._rest = b""
        self._is_overlong = False

    def feed(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Take the next bytes of the stream, return the frames to be sent and the answers, in order. Never raises."""
        *lines, self._rest = (self._rest + data.translate(None, FLOW_CONTROL)).split(b"\r")
        frames: list[Frame] = []
        answers = []
        for line in lines:
            # Some terminals end their lines with CR LF.
            answer = self._obey(line.lstrip(b"\n"), frames) if not self._is_overlong else REFUSED
            self._is_overlong = False
            self.refused += answer is REFUSED
            answers.append(answer)
        if len(self._rest) > MAX_LINE:
            self._rest = b""
            self._is_overlong = True
        return frames, b"".join(answers)

    def line(self, frame: Frame, time_ns: int) -> bytes:
        """The line that tells the client of `frame`, which passed at `time_ns` (>= 0); nothing while closed."""
        if not self.is_open:
            return b""
        can_id, data, is_extended, is_remote = frame
        kind = ("r" if is_remote else "t", "R" if is_remote else "T")[is_extended]
        identifier = f"{can_id:08X}" if is_extended else f"{can_id:03X}"
        stamp = f"{time_ns // 1_000_000 % STAMP_RANGE_MS:04X}" if self.has_stamps else ""
        payload = "" if is_remote else data.hex().upper()
        return f"{kind}{identifier}{len(data)}{payload}{stamp}\r".encode()

    def _obey(self, line: bytes, frames: list[Frame]) -> bytes:
        """The answer to one line without its end."""
        if len(line) > MAX_LINE:
            return REFUSED
        match line[:1]:
            case b"t" | b"T" | b"r" | b"R":
                frame = _read_frame(line) if self.is_open and not self.is_listening_only else None
                if frame is None:
                    return REFUSED
                frames.append(frame)
                return b"Z\r" if frame.is_extended else b"z\r"
            case b"V" if len(line) == 1:
                return VERSION
            case b"N" if len(line) == 1:
                return SERIAL_NUMBER
            case b"F" if len(line) == 1:
                return STATUS_FLAGS
        return OK if self._configure(line) else REFUSED

    def _configure(self, line: bytes) -> bool:
        """Act on a line that is answered with CR or BEL only. False when it is refused."""
        match line:
            case b"":
                pass  # clients send empty lines to end anything that was begun before
            # Opening twice and closing twice are no errors here, as they are at LAWICEL's: a client that vanished may
            # have left the channel open.
            case b"O" | b"L" | b"l":
                self.is_open = True
                self.is_listening_only = line != b"O"
            case b"C":
                self.is_open = False
            case b"Z0" | b"Z1":
                self.has_stamps = line == b"Z1"
            case b"X1":
                pass  # frames come unasked, always; X0 (wait until polled) is refused
            case _ if line[0] in (ord("S"), ord("s")):
                # S0 to S8, python-can's S9, and the two bit timing registers of an SJA1000.
                digits = line[1:].isdigit() and len(line) == 2 if line[0] == ord("S") else _is_hex(line[1:], 4)
                return digits and not self.is_open
            case _:
                return _is_hex(line[1:], _SETTINGS.get(line[0], -1))
        return True


def _is_hex(text: bytes, size: int) -> bool:
    """`size` hex digits; `int` would also accept signs, underscores and blanks."""
    return len(text) == size and _HEX_DIGITS.issuperset(text)


def _read_frame(line: bytes) -> Frame | None:
    """The frame of `t123211F1`, `T…`, `r…` or `R…`; None for what is none, of nine bytes for example."""
    is_extended, is_remote = line[0] in b"TR", line[0] in b"rR"
    digits, highest = (8, 0x1FFF_FFFF) if is_extended else (3, 0x7FF)
    identifier, length_digit, data = line[1 : 1 + digits], line[1 + digits : 2 + digits], line[2 + digits :]
    length = _DATA_LENGTHS.get(length_digit)
    if length is None or not _is_hex(identifier, digits) or not _is_hex(data, 0 if is_remote else 2 * length):
        return None
    can_id = int(identifier, 16)
    if can_id > highest:
        return None
    return Frame(can_id, bytes(length) if is_remote else bytes.fromhex(data.decode()), is_extended, is_remote)
