"""The record of an emulator that several runs use, one after the other: each has a folder of its own.

The first is recorded in the folder that was named, the second in `run-2` below it, and so on.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from canarm_protocol.canopen.frames import Cob, Frame, NmtCommand
from canarm_protocol.cell.model import Cell
from canarm_protocol.runs.run_folder import CAN_LOG_FILE, Rotation, claim_later_run, later_run

from ..bench.bench import Record
from .recording import Recorder

_START = bytes((NmtCommand.START,))
_NMT = int(Cob.NMT)


def _ends_a_run(frame: Frame) -> bool:
    return frame.can_id == _NMT and frame.data[:1] != _START


class SessionRecorder(Recorder):
    """As `Recorder`. `describe` completes the folder of each run after the first.

    What was said on the bus between two runs stands in the logs of both: the second needs its cards' configuration.
    """

    def __init__(
        self,
        folder: Path,
        cell: Cell,
        on_failure: Callable[[str], None],
        describe: Callable[[Path], None],
        frames: Rotation | None = None,
        signals: Rotation | None = None,
        *,
        with_bench: bool = False,
    ) -> None:
        super().__init__(folder, cell, on_failure, frames, signals, with_bench=with_bench)
        self._session, self._describe = folder, describe
        self._log_file, self._runs = folder / CAN_LOG_FILE, 1
        self._left: tuple[int, int] | None = None
        """In which part of this run's log, and where in it, the NMT command stands that has ended it."""

    def frames(self, records: Sequence[Record]) -> None:
        """As `Recorder.frames`."""
        if self._left is None and self._cycle >= 0:
            commands = [place for place, (_, frame, _) in enumerate(records) if frame[0] == _NMT]
            place = next((place for place in commands if _ends_a_run(records[place].frame)), None)
            if place is not None:
                super().frames(records[:place])
                with self._unwritten:
                    self._left = self._log.parts, self._log.size()
                records = records[place:]
        super().frames(records)

    def begin_run(self) -> None:
        """As `Recorder.begin_run`; if there has been a run before, in a new folder."""
        if self._cycle < 0 or self._unwritten.why is not None:
            return
        with self._unwritten:
            self.close()
            parts = self._log.parts
            self._runs += 1
            folder = claim_later_run(later_run(self._session, self._runs))
            before, left = self._log_file, self._left
            self._log_file, self._left = folder / CAN_LOG_FILE, None
            self._open(folder)
            if left is not None:
                self._log.append_from(before, left[1] if left[0] == parts else 0)
            self._describe(folder)
