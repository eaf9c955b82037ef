"""How a run is recorded besides its plain files; a record that cannot be written is reported, and the run goes on."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from canarm_protocol.runs.run_folder import Rotation, RunFolderError
from canarm_protocol.shown import quoted

from .libraries import load_library
from .usage import UsageError

if TYPE_CHECKING:
    from canarm_protocol.runs.packing import Packer

NEEDED = {"bench": None, "blf": None, "mcap": "mcap.writer", "mf4": "asammdf", "parquet": "pyarrow"}
"""What can be asked for: the frames of the bench's own bus, and formats, with the library of each that canarm does not
bring along."""
FAILED_RECORDING = "recording failed: "
"""What the reason of a record that broke off begins with."""
BENCH, PARQUET = "bench", "parquet"
MEGABYTE = 1_000_000


@dataclass(frozen=True)
class Recording:
    """What `--record` and `--rotate` ask for."""

    formats: tuple[str, ...] = ()
    rotate_bytes: int | None = None
    packer: "Packer | None" = None

    @property
    def frames(self) -> Rotation | None:
        """When the log of frames is parted."""
        return None if self.rotate_bytes is None else Rotation(self.rotate_bytes)

    @property
    def signals(self) -> Rotation | None:
        """When the tables of signals are parted."""
        if self.packer is None:
            return self.frames
        from canarm_protocol.runs.packing import PART_BYTES

        return Rotation(self.rotate_bytes or PART_BYTES, self.packer.take, takes_last=True)

    @property
    def at_the_end(self) -> tuple[str, ...]:
        """The formats that are written when a run is over."""
        return tuple(each for each in self.formats if each not in (BENCH, PARQUET))

    @property
    def with_bench(self) -> bool:
        """Whether the frames of the bench's own bus are recorded."""
        return BENCH in self.formats

    def close(self) -> None:
        """Wait for what is still being packed."""
        if self.packer is not None:
            self.packer.close()


def parse_recording(
    record: str | None, rotate_mb: float | None, out: Path | None, tell: Callable[[str], None], with_frames: bool = True
) -> Recording:
    """The recording of `--record FORMAT,…` and `--rotate MB`; the libraries are there. Raises `UsageError`."""
    if (record is not None or rotate_mb is not None) and out is None:
        option = "--record" if record is not None else "--rotate"
        raise UsageError(f"{option}: there is no record; name its folder with --out")
    formats = tuple(dict.fromkeys(each.strip() for each in (record or "").split(",") if each.strip()))
    for each in formats:
        if each not in NEEDED:
            raise UsageError(f"--record {quoted(each)}: must be {', '.join(NEEDED)}")
        if not with_frames and each != PARQUET:
            raise UsageError(f"--record {each}: the emulator records the frames; a controller has {PARQUET} only")
        library = NEEDED[each]
        if library is not None:
            load_library(library, f"--record {each}")
    packer = None
    if PARQUET in formats:
        from canarm_protocol.runs.packing import Packer

        packer = Packer(tell)
    return Recording(formats, None if rotate_mb is None else round(rotate_mb * MEGABYTE), packer)


def recording_failure(folder: Path, write: Callable[[], None]) -> str | None:
    """Call `write`, which writes into the run folder; returns the reason of a failure on one line, or None."""
    try:
        write()
    except RunFolderError as error:
        return f"{FAILED_RECORDING}{error}"
    except OSError as error:
        return f"{error.filename or folder}: {FAILED_RECORDING}{error.strerror or error}"
    return None
