"""Each joint as it is now, out of the rows of the last seconds: which row is shown, RMS, saturation, the DAC's code."""

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.bench_objects import INTERNALS
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import command_scale

from .history import Column, History
from .snapshot import JointNow

_LIMIT_TOLERANCE = 1e-6
"""Commands travel as REAL32: a command at the limit differs from it by up to 6e-8 of its value."""
MOST_ROWS_BACK = 4
_INTERNALS = slice(Column.INTERNAL, Column.INTERNAL + INTERNALS)


class JointReader:
    """Reads the joints of `cell`. A reference that is more than `match` cycles old is not shown as current."""

    def __init__(self, cell: Cell, match: int) -> None:
        self._match = match
        self._limit_a = [joint.drive.max_current_a for joint in cell.joints]
        self._step_a = [command_scale(cell, joint).lsb for joint in range(len(cell.joints))]

    def read(
        self, window: History, error_lsb: NDArray[np.float64], idle: NDArray[np.float32] | None = None
    ) -> tuple[JointNow, ...]:
        """The joints at the end of `window`; `error_lsb` (n, joints) are its errors.

        `idle` (joints, COLUMNS) is what the bench says while cycles stand still: no reference belongs to that, and no
        measurement, for nobody measures.
        """
        return tuple(self._joint(joint, window, error_lsb, idle) for joint in range(len(self._limit_a)))

    def _joint(
        self, joint: int, window: History, error_lsb: NDArray[np.float64], idle: NDArray[np.float32] | None
    ) -> JointNow:
        cycles, errors, limit_a = window.cycles, error_lsb[:, joint], self._limit_a[joint]
        if not len(cycles):
            return JointNow(limit_a=limit_a)
        matched = np.flatnonzero(np.isfinite(errors))
        row = len(cycles) - 1
        if len(matched) and cycles[-1] - cycles[matched[-1]] <= self._match:
            row = int(matched[-1])
            # The controller tells what it has measured of fewer cycles than its references.
            told = matched[np.isfinite(window.values[matched, joint, Column.MEASURED])]
            if len(told) and row - told[-1] <= MOST_ROWS_BACK:
                row = int(told[-1])
        finite = errors[matched]
        now = window.values[row, joint].tolist()
        reference_rad, error, measured_rad = now[Column.REFERENCE], float(errors[row]), now[Column.MEASURED]
        if idle is not None:
            now, reference_rad, error, measured_rad = idle[joint].tolist(), np.nan, np.nan, np.nan
        command = now[Column.COMMAND]
        code = command / self._step_a[joint]
        return JointNow(
            angle_rad=now[Column.ANGLE],
            speed_rad_s=now[Column.SPEED],
            reference_rad=reference_rad,
            error_lsb=error,
            rms_lsb=float(np.sqrt(np.mean(finite * finite))) if len(finite) else np.nan,
            max_lsb=float(np.max(np.abs(finite))) if len(finite) else np.nan,
            current_a=now[Column.CURRENT],
            command_a=command,
            saturation=int(np.sign(command)) if abs(command) >= limit_a * (1.0 - _LIMIT_TOLERANCE) else 0,
            measured_rad=measured_rad,
            limit_a=limit_a,
            code=round(abs(code)) if abs(code) < 1e9 else None,
            internals=tuple(now[_INTERNALS]),
        )
