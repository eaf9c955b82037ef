"""A blocking SDO client for the edges of a program: command lines, runners, tests against a live bench.

It waits on the wall clock, never longer than its limit. Code in virtual time drives `sdo.Transfer` itself.
"""

import time

from ..canopen.frames import Frame
from ..canopen.sdo import AbortCode, SdoAborted, Transfer, abort_request, download, upload
from ..errors import BusError
from .port import BusPort

TOTAL_S = 60.0
"""Longest transfer in all: 100 kB with 1 ms per segment take 15 s."""


class SdoSession:
    """One SDO channel of one node over an open port. Other frames that arrive meanwhile are dropped."""

    def __init__(
        self, port: BusPort, request_id: int, answer_id: int, limit_s: float = 1.0, total_s: float = TOTAL_S
    ) -> None:
        """It waits at most `limit_s` for an answer, and a transfer takes at most `total_s`."""
        self._port, self._request_id, self._answer_id = port, request_id, answer_id
        self._limit_s, self._total_s = limit_s, max(total_s, limit_s)

    def upload(self, index: int, subindex: int = 0) -> bytes:
        """Read an object. Raises `SdoAborted`, or `BusError` when no answer comes in time."""
        return self._run(upload(index, subindex), index, subindex)

    def download(self, index: int, subindex: int, value: bytes) -> None:
        """Write an object. Raises `SdoAborted`, or `BusError` when no answer comes in time."""
        self._run(download(index, subindex, value), index, subindex)

    def _run(self, transfer: Transfer, index: int, subindex: int) -> bytes:
        request, end_s = next(transfer), time.monotonic() + self._total_s
        while True:
            self._port.send([Frame(self._request_id, request)])
            answer = self._answer(end_s)
            if answer is None:
                is_over = time.monotonic() >= end_s
                self._port.send([Frame(self._request_id, abort_request(index, subindex, AbortCode.TIMED_OUT))])
                what, time_s = ("end of SDO transfer", self._total_s) if is_over else ("SDO answer", self._limit_s)
                raise BusError(
                    f"{self._port.description}: no {what} (0x{self._answer_id:03X}) within {time_s:g} s "
                    f"when asked for 0x{index:04X}:{subindex:02X}"
                )
            try:
                request = transfer.send(answer)
            except StopIteration as done:
                return bytes(done.value)
            except SdoAborted as error:
                if not error.by_server:
                    self._port.send([Frame(self._request_id, abort_request(index, subindex, error.code))])
                raise

    def _answer(self, end_s: float) -> bytes | None:
        deadline = min(time.monotonic() + self._limit_s, end_s)
        while (left := deadline - time.monotonic()) > 0:
            for _, frame in self._port.receive(left):
                if frame.can_id == self._answer_id and not frame.is_extended and not frame.is_remote:
                    return frame.data
        return None
