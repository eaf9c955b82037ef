"""What a controller detects, as values, as the plain objects of the bench node, and as frames.

On the bench bus a detection is a text in pieces of eight bytes, as CiA 301 sends what a program prints (0x1026): the
controller waits for no answer in its cycle. The text is STX, a checksum in four hexadecimal digits (CRC-16-CCITT, as in
SDO block transfer), a line of JSON, NUL. Which detectors there are is not known here.
"""

import json
from binascii import crc_hqx
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

DETECTION = "detection"
PIECE = 8
"""Bytes in a frame."""
LONGEST_DETAIL = 200
"""Characters of a detail; a longer one is cut."""
LONGEST_TEXT = 2048
"""Bytes of a line; beyond that it is no detection."""
_BEGIN, _END = b"\2", b"\0"
"""Neither stands in a line of JSON: a text whose end was lost does not spoil the next one."""
_CHECKED = len(_BEGIN) + 4


class DetectionEvent(NamedTuple):
    """A detection in the controller's cycle `cycle`, which is that of the bench since NMT start.

    `where` is a joint or a node; None is the run as a whole. `detail` and `reaction` are in words. `time_ns` is the
    virtual time at which the bench heard of it; 0 if it has not yet.
    """

    cycle: int
    detector: str
    where: str | None
    detail: str
    reaction: str
    time_ns: int = 0


def detection_as_plain(event: DetectionEvent) -> dict[str, Any]:
    """The event as plain values, in the order of `events.jsonl`; a long detail is cut."""
    detail = event.detail if len(event.detail) <= LONGEST_DETAIL else event.detail[: LONGEST_DETAIL - 1] + "…"
    fields = event._replace(detail=detail)._asdict()
    return {"time_ns": fields.pop("time_ns"), "event": DETECTION, **fields}


def detection_from_plain(plain: Mapping[str, Any]) -> DetectionEvent:
    """What `detection_as_plain` made of an event. Raises `KeyError` or `TypeError` if it did not."""
    cycle, where = plain["cycle"], plain["where"]
    texts = plain["detector"], plain["detail"], plain["reaction"], where or ""
    if type(cycle) is not int or not all(isinstance(text, str) for text in texts):
        raise TypeError("not a detection")
    return DetectionEvent(cycle, plain["detector"], where, plain["detail"], plain["reaction"], plain.get("time_ns", 0))


def pieces_of(event: DetectionEvent) -> Iterator[int]:
    """The event as the values of an UNSIGNED64, one after the other."""
    line = json.dumps(detection_as_plain(event), separators=(",", ":")).encode()
    text = _BEGIN + _checksum(line) + line + _END
    for first in range(0, len(text), PIECE):
        yield int.from_bytes(text[first : first + PIECE].ljust(PIECE, _END), "little")


class Pieces:
    """Puts detections together again."""

    def __init__(self) -> None:
        self.broken = 0
        """Texts that could not be read: pieces were lost, or something else was sent."""
        self._text = b""

    def take(self, piece: int) -> DetectionEvent | None:
        """The detection that ends with this piece, if one does."""
        data = piece.to_bytes(PIECE, "little")
        if data.startswith(_BEGIN):
            self.broken += bool(self._text)
            self._text = b""
        self._text += data
        if len(self._text) <= LONGEST_TEXT and _END not in data:
            return None
        text, self._text = self._text, b""
        try:
            line = text[_CHECKED : text.index(_END)]
            if text[:_CHECKED] != _BEGIN + _checksum(line):
                raise ValueError
            return detection_from_plain(json.loads(line))
        except (KeyError, TypeError, ValueError, RecursionError):
            self.broken += 1
            return None


def _checksum(line: bytes) -> bytes:
    return f"{crc_hqx(line, 0):04x}".encode()
