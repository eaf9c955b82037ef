"""Packs complete parts of a run's signals as Parquet, in a thread of its own: the loop waits for nothing.

A part stays as CSV until its Parquet file is whole: a kill loses none.
"""

import io
import queue
import threading
from collections.abc import Callable
from pathlib import Path

from .own_file import replace_file

PART_BYTES = 8 << 20
"""Of CSV: about a minute of two joints at 400 Hz."""
WHOLE, EXACT = ("cycle",), ("time_s", "power_on_s")
"""Columns of whole numbers, and of double precision; all others have single precision, 7 digits."""
SUFFIX = ".parquet"
END_S = 60.0
"""How long the end of a run waits for the last parts."""


class Packer:
    """Takes CSV files; `tell` is told of one that cannot be packed, and stays. Needs pyarrow."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._paths: queue.SimpleQueue[Path | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def take(self, path: Path) -> None:
        """Pack `path` soon."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="packing", daemon=True)
            self._thread.start()
        self._paths.put(path)

    def close(self) -> None:
        """Wait until all is packed. May be called again."""
        thread, self._thread = self._thread, None
        if thread is not None:
            self._paths.put(None)
            thread.join(END_S)

    def _work(self) -> None:
        while (path := self._paths.get()) is not None:
            try:
                pack(path)
            except Exception as error:
                self._tell(f"{path.name} stays as it is: it could not be packed: {error}")


def pack(path: Path) -> Path:
    """Replace a CSV file of signals by a Parquet file, whose path is returned. Raises `OSError`, `ImportError`."""
    import pyarrow
    from pyarrow import csv, parquet

    table = csv.read_csv(path)
    floats = {name: pyarrow.float64() if name in EXACT else pyarrow.float32() for name in table.column_names}
    kinds = [pyarrow.field(name, pyarrow.int64() if name in WHOLE else kind) for name, kind in floats.items()]
    # The bytes of a number by themselves: signals change little from row to row, in their first bytes.
    by_bytes = {"use_dictionary": False, "use_byte_stream_split": [name for name in floats if name not in WHOLE]}
    packed = io.BytesIO()
    parquet.write_table(table.cast(pyarrow.schema(kinds)), packed, compression="zstd", **by_bytes)
    target = path.with_suffix(SUFFIX)
    replace_file(target, packed.getvalue())
    path.unlink()
    return target
