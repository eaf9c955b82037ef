"""An slcan adapter on a pseudo-terminal, for programs that want a serial port.

Owns the terminal and the link that names it. A client may change its line discipline, modes and locks: they are reset
when the client has gone, or a new terminal takes its place. Output that a client has stopped goes on at once.
"""

import contextlib
import errno
import logging
import os
import select
import shlex
import stat
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .edges import EdgeSelector
from .slcan_port import QUEUE_BYTES, SOCKET_URL, SlcanError, SlcanPort, SlcanRefusedError

_PACKET_DATA, _PACKET_STOP = 0, 4
"""TIOCPKT_DATA and TIOCPKT_STOP of <sys/ioctl.h>, which `termios` has on some systems only."""
_LOCAL_MODES = 3
"""Where `termios.tcgetattr` has c_lflag."""
_OFF, _ON = struct.pack("i", 0), struct.pack("i", 1)

_log = logging.getLogger(__name__)


class SlcanTerminal(SlcanPort):
    """An slcan adapter on a pseudo-terminal with a fixed name, a symbolic link.

    Each time that the last client has closed the terminal, it is put right for the next one, also if not a word was
    said. Without edges (`edges`), a pseudo-terminal without a user is at its end all the time: this side holds it open
    then until a client's first input.
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
        self._has_edges = hasattr(select, "epoll")
        super().__init__(queue_bytes, EdgeSelector() if self._has_edges else None)
        self._held, self._name, self._terminal = -1, "", _TerminalLine(-1, self._go_on)
        self._settings: list[Any] = []
        self._mode = 0
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
        self._let_go()
        self._terminal.close()
        self._remove_link()
        self._name = ""

    def _make(self, openpty: Callable[[], tuple[int, int]]) -> None:
        """A new terminal in raw mode. Raises `OSError`, `termios.error`."""
        import fcntl
        import termios
        import tty

        master, self._held = openpty()
        self._terminal = _TerminalLine(master, self._go_on)
        self._name = os.ttyname(self._held)
        os.set_blocking(master, False)
        tty.setraw(self._held, termios.TCSANOW)
        fcntl.ioctl(master, termios.TIOCPKT, _ON)
        self._settings, self._mode = termios.tcgetattr(self._held), stat.S_IMODE(os.fstat(self._held).st_mode)
        if self._has_edges:
            self._let_go()

    def _prepare(self) -> None:
        """Make the terminal as new; what the last client has left unread goes. Raises `OSError`, `termios.error`."""
        import fcntl
        import termios

        fd, master = self._held, self._terminal.master
        # slcand leaves its line discipline behind when a signal ends it.
        with contextlib.suppress(OSError):
            fcntl.ioctl(fd, termios.TIOCNXCL)
            fcntl.ioctl(fd, termios.TIOCSETD, struct.pack("i", 0))
        fcntl.ioctl(master, termios.TIOCPKT, _OFF)  # or this would be told of what follows
        termios.tcflow(fd, termios.TCOON)
        termios.tcsetattr(fd, termios.TCSANOW, self._settings)
        termios.tcflush(fd, termios.TCIOFLUSH)
        fcntl.ioctl(master, termios.TIOCPKT, _ON)
        os.fchmod(fd, self._mode)
        if termios.tcgetattr(fd) != self._settings:
            raise OSError(errno.EPERM, "the settings of the terminal are locked")

    def _hear(self) -> None:
        import termios

        with contextlib.suppress(OSError, termios.error):
            settings = termios.tcgetattr(self._terminal.master)
            if settings[_LOCAL_MODES] & termios.ECHO:
                settings[_LOCAL_MODES] &= ~termios.ECHO  # or the adapter would answer its own answers
                termios.tcsetattr(self._terminal.master, termios.TCSANOW, settings)
        self._let_go()

    def _let_go(self) -> None:
        if self._held >= 0:
            os.close(self._held)
            self._held = -1

    def _go_on(self) -> None:
        """A client has stopped the terminal's output (`tcflow`): let it go on, unless the terminal is its alone."""
        import termios

        with contextlib.suppress(OSError, termios.error):
            fd = os.open(self._name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                termios.tcflow(fd, termios.TCOON)
            finally:
                os.close(fd)

    def _release(self) -> None:
        try:
            if self._held < 0:
                Path(self._name).chmod(self._mode)
                self._held = os.open(self._name, os.O_RDWR | os.O_NOCTTY)
            self._prepare()
            if self._has_edges:
                self._let_go()
        except (OSError, termios_error()):
            self._replace()
        if self._name:
            self._attach(self._terminal)

    def _replace(self) -> None:
        """Give the name to a new terminal: a client has left the old one unusable."""
        import pty

        self._let_go()
        self._terminal.close()
        self._remove_link()
        self.replaced += 1
        try:
            self._make(pty.openpty)
            _make_link(self._link, self._name)
        except (OSError, SlcanError, SlcanRefusedError, termios_error()) as error:
            self._let_go()
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
    """This side of a terminal in packet mode (ioctl_tty(2), TIOCPKT): each read begins with a byte of state."""

    def __init__(self, master: int, on_stop: Callable[[], None]) -> None:
        self.master = master
        self._on_stop = on_stop

    def close(self) -> None:
        if self.master >= 0:
            os.close(self.master)
            self.master = -1

    def fileno(self) -> int:
        return self.master

    def read(self, size: int) -> bytes:
        data = os.read(self.master, 1 + size)
        if not data or data[0] == _PACKET_DATA:
            return data[1:]
        if data[0] & _PACKET_STOP:
            self._on_stop()
        raise BlockingIOError

    def write(self, data: bytearray) -> int:
        return os.write(self.master, data)
