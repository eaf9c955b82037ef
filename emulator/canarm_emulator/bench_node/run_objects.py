"""The bench node's objects of a run as a whole: how the controller says it has ended, and whether it is recorded.

Who records, and where, is known elsewhere.
"""

from collections.abc import Callable
from typing import Protocol

from canarm_protocol.canopen.sdo import AbortCode
from canarm_protocol.cell.bench_objects import LONGEST_OUTCOME

from ..node.store import SdoRefused

NOTHING_YET = b"\n"
"""Stands for no text: an empty object cannot be read by SDO."""
NO_RECORDER = "not recorded: the emulator was started without --out DIR"


class RecordSwitch(Protocol):
    """Who records, on a disk that may fill up."""

    @property
    def is_on(self) -> bool:
        """Whether it records."""

    @property
    def place(self) -> str:
        """The folder."""

    @property
    def failure(self) -> str | None:
        """Why nothing is written any more."""


class RunObjects:
    """`attach` says who records, and who switches that on and off."""

    def __init__(self) -> None:
        self._outcome = b""
        self._recorder: RecordSwitch | None = None
        self._switch: Callable[[bool], None] | None = None

    def attach(self, recorder: RecordSwitch, switch: Callable[[bool], None]) -> None:
        """From now on `recorder` can be switched, by calling `switch`."""
        self._recorder, self._switch = recorder, switch

    def forget_outcome(self) -> None:
        """Another run goes on."""
        self._outcome = b""

    def outcome(self) -> bytes:
        """What the controller has said of the end of its run; an empty line before."""
        return self._outcome or NOTHING_YET

    def set_outcome(self, text: bytes) -> None:
        """The controller says how its run has ended. Raises `SdoRefused` where that is too long."""
        if len(text) > LONGEST_OUTCOME:
            raise SdoRefused(AbortCode.TOO_LONG)
        self._outcome = text

    def is_recording(self) -> bool:
        """Whether frames and signals are recorded now."""
        recorder = self._recorder
        return recorder is not None and recorder.is_on and recorder.failure is None

    def record(self, is_on: bool) -> None:
        """Record from now on, or no longer. Raises `SdoRefused` where nobody can; `place` says why."""
        recorder, switch = self._recorder, self._switch
        if recorder is None or switch is None or recorder.failure is not None:
            if is_on:
                raise SdoRefused(AbortCode.DEVICE_STATE)
        elif recorder.is_on is not is_on:
            switch(is_on)

    def place(self) -> str:
        """The folder, or why nothing is recorded."""
        recorder = self._recorder
        if recorder is None:
            return NO_RECORDER
        text = recorder.place if recorder.failure is None else f"not recorded any more: {recorder.failure}"
        return text.encode("ascii", "backslashreplace").decode("ascii")
