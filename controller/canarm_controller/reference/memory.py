"""The Apple II's memory as the paper's controller used it: torque table and measurement log, byte by byte.

Owns addresses and the coding of a table byte. Nothing here knows about dynamics, control or the bus.

Memory map of a bank, a page of 4096 samples (10.24 s at 2.5 ms) for each joint and quantity:

    $2000-$2FFF  torque table, first joint      $3000-$3FFF  torque table, second joint
    $4000-$4FFF  measured position, first       $5000-$5FFF  measured position, second
    $6000-$6FFF  measured velocity, first       $7000-$7FFF  measured velocity, second

A bank holds two joints, because the paper's 8 KiB of table do; further joints take further banks at the same addresses,
as on a memory card that is switched. Bank b holds joints 2b + 1 and 2b + 2 of the cell; the second half of each page
pair stays 0 where there is no such joint. `dump` gives the banks one after the other, 24 KiB each.

The paper keeps table and measurements in $2000-$3FFF, but two joints' tables fill that; the log has pages of its own
and wraps around like the table. Nor does the paper say how a table byte carries its sign. Here bit 7 is the direction
(1 = clockwise, negative) and bits 6..0 are the magnitude, so that one `ASL A` leaves the DAC code in A and the
direction in the carry. Magnitude 127 is code 254 of an 8-bit DAC: the table resolves two of its steps, and zero is
always $00. A table byte means the same current whatever the DAC's resolution. What goes into the log is a byte too: the
upper eight bits of a converter's code, the lower eight of an encoder's count.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import MemoryImageError

TABLE_BASE = 0x2000
SAMPLES = 4096
BANK_JOINTS = 2
BANK_BYTES = 3 * BANK_JOINTS * SAMPLES
"""Table, position and velocity of two joints: 24 KiB."""
BANK_END = TABLE_BASE + BANK_BYTES
"""First address above a bank: $8000, well below the end of a 48 KiB Apple II+'s RAM at $C000."""
DIRECTION_BIT = 0x80
MAGNITUDE_MASK = 0x7F
TABLE_BITS = 8
"""Bits of a table byte."""
DAC_STEPS = 255
"""DAC code at full-scale current."""


def encode_table_byte(current_a: NDArray[np.float64], max_current_a: float) -> NDArray[np.uint8]:
    """Currents in A (any shape) as table bytes; beyond full scale they stick at magnitude 127."""
    step_a = 2.0 * max_current_a / DAC_STEPS
    magnitude = np.minimum(np.rint(np.abs(current_a) / step_a), MAGNITUDE_MASK).astype(np.uint8)
    clockwise = (current_a < 0) & (magnitude > 0)
    return np.where(clockwise, magnitude | np.uint8(DIRECTION_BIT), magnitude).astype(np.uint8)


def decode_table_byte(byte: int) -> tuple[int, bool]:
    """DAC code (0..254) and direction (true = clockwise, negative) of a table byte, as `ASL A` would give them."""
    return (byte << 1) & 0xFF, bool(byte & DIRECTION_BIT)


class MemoryImage:
    """RAM from $2000 to $7FFF, in banks: table and log of joints whose amplifiers give `max_current_a` at full scale.

    Raises `MemoryImageError` for no joint, or a current that is not positive.
    """

    def __init__(self, joint_count: int, max_current_a: float | Sequence[float] = 1.5) -> None:
        if joint_count < 1:
            raise MemoryImageError(f"memory image of {joint_count} joints; must be of 1 at least")
        scales = [max_current_a] * joint_count if isinstance(max_current_a, int | float) else list(max_current_a)
        if len(scales) != joint_count or not all(scale > 0 for scale in scales):
            raise MemoryImageError(
                f"max_current_a = {max_current_a}: must be positive, one value for each of {joint_count} joints"
            )
        self.joint_count = joint_count
        self.bank_count = -(-joint_count // BANK_JOINTS)
        self._max_current_a = scales
        self._ram = bytearray(self.bank_count * BANK_BYTES)
        starts = [joint // BANK_JOINTS * BANK_BYTES + joint % BANK_JOINTS * SAMPLES for joint in range(joint_count)]
        self._tables = starts
        self._logs = [start + BANK_JOINTS * SAMPLES for start in starts] + [
            start + 2 * BANK_JOINTS * SAMPLES for start in starts
        ]
        self._current_of_byte = [_currents_by_byte(scale) for scale in scales]

    def load_table(self, joint: int, currents_a: NDArray[np.float64]) -> int:
        """Fill the table of `joint` (0-based) from sample 0 on with currents in A, shape (n,), n <= 4096.

        Returns how many samples were beyond full scale and were limited to it.
        Raises `MemoryImageError` for too many samples, no such joint, or a value that is not finite.
        """
        self._check_joint(joint)
        currents = np.asarray(currents_a, dtype=np.float64)
        if currents.ndim != 1 or len(currents) > SAMPLES:
            raise MemoryImageError(
                f"torque table of joint {joint}: shape {currents.shape}; must be (n,) with n <= {SAMPLES}"
            )
        if not np.isfinite(currents).all():
            sample = int(np.flatnonzero(~np.isfinite(currents))[0])
            raise MemoryImageError(
                f"torque table of joint {joint}, sample {sample}: {currents[sample]}; must be finite"
            )
        scale = self._max_current_a[joint]
        start = self._tables[joint]
        self._ram[start : start + len(currents)] = encode_table_byte(currents, scale).tobytes()
        return int(np.count_nonzero(np.abs(currents) > scale))

    def table_current_a(self, joint: int, sample: int) -> float:
        """Current in A that the table holds for `joint` (0-based) at `sample`, which wraps around at 4096."""
        return self._current_of_byte[joint][self._ram[self._tables[joint] + sample % SAMPLES]]

    def table_bytes(self, joint: int) -> memoryview:
        """The table of `joint` (0-based), 4096 bytes, as it stands at any time; read only."""
        self._check_joint(joint)
        return memoryview(self._ram).toreadonly()[self._tables[joint] :][:SAMPLES]

    def currents_by_byte(self, joint: int) -> Sequence[float]:
        """Current in A of each of the 256 table bytes, at `joint` (0-based)."""
        self._check_joint(joint)
        return tuple(self._current_of_byte[joint])

    def log(self, sample: int, position_codes: Sequence[int], velocity_codes: Sequence[int]) -> None:
        """Store a byte (0..255) of position and one of velocity of each joint at `sample`, which wraps around at 4096.

        Raises `MemoryImageError` for what is not a byte.
        """
        ram, place = self._ram, sample % SAMPLES
        try:
            for start, code in zip(self._logs, (*position_codes, *velocity_codes), strict=True):
                ram[start + place] = code
        except (ValueError, TypeError):
            raise MemoryImageError(
                f"log at sample {sample}: positions {list(position_codes)}, velocities {list(velocity_codes)}; "
                f"must be {self.joint_count} bytes 0..255 each"
            ) from None

    def peek(self, address: int, bank: int = 0) -> int:
        """The byte at an Apple II address of a bank. Raises `MemoryImageError` outside the image."""
        if not TABLE_BASE <= address < BANK_END:
            raise MemoryImageError(f"address ${address:04X}: the image spans ${TABLE_BASE:04X}-${BANK_END - 1:04X}")
        if not 0 <= bank < self.bank_count:
            raise MemoryImageError(f"bank {bank}: {self.joint_count} joints take banks 0 to {self.bank_count - 1}")
        return self._ram[bank * BANK_BYTES + address - TABLE_BASE]

    def dump(self) -> bytes:
        """All bytes, bank after bank, the first of each at $2000."""
        return bytes(self._ram)

    def _check_joint(self, joint: int) -> None:
        if not 0 <= joint < self.joint_count:
            raise MemoryImageError(f"joint {joint}: the image holds joints 0 to {self.joint_count - 1}")


def _currents_by_byte(max_current_a: float) -> list[float]:
    """Current in A of each of the 256 table bytes, so that the control cycle looks it up instead of computing it."""
    decoded = (decode_table_byte(byte) for byte in range(256))
    return [(-code if clockwise else code) * max_current_a / DAC_STEPS for code, clockwise in decoded]
