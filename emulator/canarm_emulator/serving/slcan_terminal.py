"""An slcan adapter on a pseudo-terminal, for programs that want a serial port.

Owns the terminal and the link that names it. A client may change its line discipline, modes and locks: they are reset
when the client has gone, or a new terminal takes its place.
"""

import contextlib
import logging
import os
import shlex
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

from .slcan_port import QUEUE_BYTES, SOCKET_URL, SlcanError, SlcanPort, SlcanRefusedError

_log = logging.getLogger(__name__)


class SlcanTerminal(SlcanPort):
    """An slcan adapter on a pseudo-terminal with a fixed name, a symbolic link.

    While no client has the terminal open, this side holds it open: a pseudo-terminal without a user reports end of file
    all the time. At a client's first input this side closes it, so that it sees when the client has gone.
    """

    def __init__(self, link: Path | None = None, *, queue_bytes: int = QUEUE_BYTES) -> None:
        """Make the terminal, and `link` (default: `default_link()`) to it.

        Raises `SlcanError`: no pseudo-terminals here, or something else has that name.
        """
        try:
            import pty
        except ImportError:
            raise SlcanError(
                f"--slcan: this system has no pseudo-terminals; take --slcan {SOCKET_URL}127.0.0.1:0"
            ) from None
        super().__init__(queue_bytes)
        self._held, self._name, self._terminal = -1, "", _TerminalLine(-1)
        self.replaced = 0
        """How often a client has left its terminal unusable, so that a new one had to take its place."""
        self._link = (default_link() if link is None else link).absolute()
        try:
            self._make(pty.openpty)
            _make_link(self._link, self._name)
        except (OSError, termios_error()) as error:
            self.close()
            raise SlcanRefusedError(f"--slcan: no pseudo-terminal to be had: {error.args[-1]}") from error
        except SlcanError:
            self.close()
            raise
        self.description = f"-i slcan -c {shlex.quote(str(self._link))}"
        self._attach(self._terminal)

    def close(self) -> None:
        """Give the terminal back and remove the link, unless it leads elsewhere by now. May be called again."""
        super().close()
        self._hear()
        self._terminal.close()
        self._remove_link()
        self._name = ""

    def _make(self, openpty: Callable[[], tuple[int, int]]) -> None:
        """A new terminal, held open by this side. Raises `OSError`, `termios.error`."""
        master, self._held = openpty()
        self._terminal = _TerminalLine(master)
        self._name = os.ttyname(self._held)
        os.set_blocking(master, False)
        self._prepare()

    def _prepare(self) -> None:
        """Set raw mode and discard what the last client has left unread. Raises `OSError`, `termios.error`."""
        import fcntl
        import termios
        import tty

        # slcand leaves its line discipline behind when a signal ends it.
        with contextlib.suppress(OSError):
            fcntl.ioctl(self._held, termios.TIOCNXCL)
            fcntl.ioctl(self._held, termios.TIOCSETD, struct.pack("i", 0))
        tty.setraw(self._held)
        termios.tcflush(self._held, termios.TCIOFLUSH)

    def _hear(self) -> None:
        if self._held >= 0:
            os.close(self._held)
            self._held = -1

    def _release(self) -> None:
        try:
            if self._held < 0:
                self._held = os.open(self._name, os.O_RDWR | os.O_NOCTTY)
            self._prepare()
        except (OSError, termios_error()):
            self._replace()
        if self._name:
            self._attach(self._terminal)

    def _replace(self) -> None:
        """Give the name to a new terminal: a client has left the old one unusable."""
        import pty

        self._hear()
        self._terminal.close()
        self._remove_link()
        self.replaced += 1
        try:
            self._make(pty.openpty)
            _make_link(self._link, self._name)
        except (OSError, SlcanError, SlcanRefusedError, termios_error()) as error:
            self._hear()
            self._terminal.close()
            self._name = ""
            _log.error("--slcan %s: a client has broken the terminal, and there is no other: %s", self._link, error)

    def _remove_link(self) -> None:
        """Remove the link, unless it leads elsewhere by now."""
        with contextlib.suppress(OSError):
            if self._name and str(self._link.readlink()) == self._name:
                self._link.unlink()


def termios_error() -> type[Exception]:
    """`termios.error`, which functions on terminals raise besides `OSError`; `OSError` on systems without terminals."""
    try:
        import termios
    except ImportError:
        return OSError
    return termios.error


def default_link() -> Path:
    """The default name of the terminal: in the user's runtime folder, or in that for temporary files."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_dir():
        return Path(runtime, "canarm-can0")
    return Path(tempfile.gettempdir(), f"canarm-{os.getuid()}-can0")


def _make_link(link: Path, terminal: str) -> None:
    try:
        # A killed emulator leaves its link. It leads nowhere, or to a terminal of the same name, which is ours now.
        if link.is_symlink() and (not link.exists() or str(link.readlink()) == terminal):
            link.unlink()
        link.symlink_to(terminal)
    except FileExistsError as error:
        raise SlcanRefusedError(
            f"--slcan {link}: that name is taken; if no other emulator uses it, remove it, or choose another PATH"
        ) from error
    except OSError as error:
        raise SlcanRefusedError(f"--slcan {link}: {error.strerror or error}; choose another PATH") from error


class _TerminalLine:
    def __init__(self, master: int) -> None:
        self.master = master

    def close(self) -> None:
        if self.master >= 0:
            os.close(self.master)
            self.master = -1

    def fileno(self) -> int:
        return self.master

    def read(self, size: int) -> bytes:
        return os.read(self.master, size)

    def write(self, data: bytearray) -> int:
        return os.write(self.master, data)
