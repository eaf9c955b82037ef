"""Files that are made in a folder that others may write to: what was planted there is never followed.

A link, a pipe, a device or a second name of somebody's file is refused in a line; whole files are replaced, not opened.
A disk that fills up leaves whole lines and whole files. What is written belongs to the caller.
"""

import contextlib
import errno
import mmap
import os
import stat
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # no POSIX: processes that share a file on a full disk may then cut each other's lines
    fcntl = None

_NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)
_NO_WAIT = getattr(os, "O_NONBLOCK", 0)
"""A pipe that nobody reads would hold up whoever opens it."""
PAGE = mmap.PAGESIZE
LOCK_S = 5.0
"""After so long a lock is taken for that of a process that was killed."""
LONGEST_TURN_S = 0.1
"""How long one that appends is waited for: a line takes microseconds."""


def open_new(path: Path) -> int:
    """A file descriptor of `path`, for writing, which must not be there yet. Raises `OSError`."""
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _NO_FOLLOW, 0o666)


def open_own(path: Path, *, append: bool = False) -> int:
    """A file descriptor of `path`, for writing: a new file, or one that is there already, emptied unless `append`.

    What is written goes to the end of the file, also after a cut (`append_lines`).
    Raises `OSError` for what cannot be written and for what is no plain file of its own.
    """
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | _NO_FOLLOW | _NO_WAIT, 0o666)
    except OSError:
        if path.is_symlink():
            raise _no_own_file(path) from None
        raise
    try:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
            raise _no_own_file(path)
        if not append:
            os.ftruncate(descriptor, 0)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def create_file(path: Path, data: bytes) -> None:
    """Make `path`, which must not be there yet, with `data` in it. Raises `OSError`; nothing is then left of it."""
    with os.fdopen(open_new(path), "wb", buffering=0) as file:
        try:
            write_all(file.fileno(), data)
        except OSError:
            with contextlib.suppress(OSError):
                path.unlink()
            raise


def _no_own_file(path: Path) -> OSError:
    return OSError(0, "is a link or no plain file; remove it", str(path))


def replace_file(path: Path, data: bytes) -> None:
    """Put `data` in the place of `path` in one piece: a reader sees the file before or after, never half of it.

    Raises `OSError` with the name of the file.
    """
    replace_files({path: data})


def replace_files(texts: Mapping[Path, bytes]) -> None:
    """As `replace_file`, for several: all are written before the first takes its place.

    Raises `OSError` with the name of the file that cannot be written; all are then as they were.
    """
    drafts = {path: path.with_name(f".{path.name}.{os.getpid()}") for path in texts}
    path = Path()
    try:
        for path, draft in drafts.items():
            if path.is_dir() and not path.is_symlink():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            draft.unlink(missing_ok=True)
            create_file(draft, texts[path])
        for path, draft in drafts.items():
            draft.replace(path)
    except OSError as error:
        for draft in drafts.values():
            with contextlib.suppress(OSError):
                draft.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from None


def hold_folder(path: Path) -> int | None:
    """Say that this process writes into the folder `path`, until the descriptor that it returns is closed.

    None where the system or the file system knows no locks. The hold ends with the process, however that ends.
    """
    if fcntl is None:
        return None
    descriptor = None
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        if descriptor is not None:
            os.close(descriptor)
        return None
    return descriptor


def is_held(path: Path) -> bool:
    """Whether a process says that it writes into the folder `path` (`hold_folder`). Raises `OSError`."""
    if fcntl is None:
        return False
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return False
    finally:
        os.close(descriptor)
    return False


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """A lock between processes, by an exclusively created file; that of a killed process is taken over."""
    limit = time.monotonic() + LOCK_S
    while True:
        try:
            os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
            break
        except FileExistsError:
            if time.monotonic() > limit:
                break
            time.sleep(0.01)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def append_lines(descriptor: int, data: bytes) -> None:
    """Write `data`, which ends with a line end, at the end of an open file, in whole lines however full the disk is.

    Processes that append to one file take turns. Raises `OSError`; the lines that fitted are then in the file.

    A kernel that kills a process ends its write between two pages. So only a line that crosses from one into the next
    could be cut, and it is written alone.
    """
    with _turn(descriptor):
        size = os.fstat(descriptor).st_size
        try:
            for piece in _within_pages(data, size):
                write_all(descriptor, piece)
        except OSError:
            with contextlib.suppress(OSError):
                written = os.fstat(descriptor).st_size - size
                os.ftruncate(descriptor, size + data.rfind(b"\n", 0, written) + 1)
            raise


def _within_pages(data: bytes, offset: int) -> Iterator[bytes]:
    """Whole lines of `data`, to be written at `offset`, in pieces that cross no page, or are one line that does."""
    begin = 0
    while begin < len(data):
        end = begin + PAGE - (offset + begin) % PAGE
        if end < len(data):
            end = data.rfind(b"\n", begin, end) + 1 or data.find(b"\n", begin) + 1 or len(data)
        yield data[begin:end]
        begin = end


def write_all(descriptor: int, data: bytes) -> None:
    """Write `data`, however many times the system takes a part of it only. Raises `OSError`."""
    left = memoryview(data)
    while left:
        left = left[os.write(descriptor, left) :]


@contextlib.contextmanager
def _turn(descriptor: int) -> Iterator[None]:
    """Keep others from appending meanwhile, where the file system knows how; who keeps the file for long is ignored."""
    if fcntl is None:
        yield
        return
    limit_s = time.monotonic() + LONGEST_TURN_S
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        except BlockingIOError:
            if time.monotonic() > limit_s:
                break
            time.sleep(0.001)
        except OSError:  # a file system without locks
            break
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_UN)
